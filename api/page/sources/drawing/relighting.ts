/**
 * Relighting of a result by WebGL: albedo · max(0, n·l), with a lobe about the half vector for the glossy surface. The
 * formula is that of the report's movable light.
 */
export type Surface = "own" | "clay" | "gloss";

const VERTEX = `#version 300 es
in vec2 corner; out vec2 place;
void main() { place = vec2(corner.x, 1.0 - corner.y); gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0); }`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D normals, albedo; uniform vec3 light; uniform int surface;
in vec2 place; out vec4 colour;
void main() {
  vec4 ground = texture(albedo, place);
  if (ground.a < 0.5) { colour = vec4(0.0); return; }
  vec3 n = texture(normals, place).xyz * 2.0 - 1.0;
  float facing = max(0.0, dot(n, light));
  float value = facing * (surface == 0 ? pow(ground.r, 2.2) : 0.75);
  if (surface == 2 && facing > 0.0) value += 0.5 * pow(max(0.0, dot(n, normalize(light + vec3(0, 0, 1)))), 40.0);
  colour = vec4(vec3(pow(min(1.0, value), 1.0 / 2.2)), 1.0);
}`;

export class Relighting {
  private readonly gl: WebGL2RenderingContext;
  private readonly program: WebGLProgram;

  /** Throws Error if the browser has no WebGL 2. */
  constructor(
    readonly canvas: HTMLCanvasElement,
    normals: TexImageSource,
    albedo: ImageData,
  ) {
    const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true });
    if (!gl) throw new Error("no WebGL 2");
    this.gl = gl;
    this.program = this.compiled();
    const corners = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
    const corner = gl.getAttribLocation(this.program, "corner");
    gl.enableVertexAttribArray(corner);
    gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
    gl.useProgram(this.program);
    this.texture("normals", 0, normals);
    this.texture("albedo", 1, albedo);
    gl.viewport(0, 0, canvas.width, canvas.height);
  }

  /** Draws the surface under a distant light from the unit vector `light` (view frame). */
  draw(light: readonly [number, number, number], surface: Surface): void {
    const { gl, program } = this;
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.uniform3f(gl.getUniformLocation(program, "light"), ...light);
    gl.uniform1i(gl.getUniformLocation(program, "surface"), ["own", "clay", "gloss"].indexOf(surface));
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** Releases the context, because browsers keep a limited number of them. */
  close(): void {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  private texture(name: string, unit: number, source: TexImageSource): void {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, source);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.LINEAR);
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
    gl.uniform1i(gl.getUniformLocation(this.program, name), unit);
  }

  private compiled(): WebGLProgram {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of [
      [gl.VERTEX_SHADER, VERTEX],
      [gl.FRAGMENT_SHADER, FRAGMENT],
    ] as const) {
      const shader = gl.createShader(kind)!;
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "shader");
    return program;
  }
}
