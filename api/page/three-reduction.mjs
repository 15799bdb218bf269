// esbuild plugin: bundles of three.js only what the cell's view uses, and its shaders without comments and indentation.
//
// three.js looks its shaders up by name at run time, so that no bundler can tell which are unused: all of them are a third
// of the library. Which ones the view's materials need is stated here; what those include is followed. A shader that is
// missing shows as an error in the browser tests, which allow none.
import { readFile } from "node:fs/promises";
import { basename, dirname, join } from "node:path";
import { createRequire } from "node:module";

const root = dirname(dirname(createRequire(import.meta.url).resolve("three")));
const shaders = join(root, "src/renderers/shaders");

/** Shaders of the materials in use: lines, points, sprites, matt surfaces. */
const USED = ["linedashed", "meshbasic", "meshlambert", "points", "sprite"];
/** Parts of those that need what the view has not (each is within an #ifdef of it): shadows, fog, textures, skins, … */
const SPARED =
  /^(shadowmap|lightprobes|morph|skin|envmap|bumpmap|normalmap|displacementmap|lightmap|aomap|emissivemap|fog|logdepthbuf|clipping_planes|batching)/;
/** Shaders that the renderer itself takes, without an include. */
const DIRECT = ["colorspace_pars_fragment"];
/** Modules of devices and effects that the view has not: virtual reality, environment maps, morphing, passes over the
 * finished picture, uniform buffers, the table for glossy surfaces. */
const ABSENT = {
  "WebXRManager.js": `import { EventDispatcher } from "../../core/EventDispatcher.js";
    export class WebXRManager extends EventDispatcher {
      enabled = false; isPresenting = false; cameraAutoUpdate = false;
      getCamera() { return null; } getEnvironmentBlendMode() { return null; } getSession() { return null; }
      getDepthSensingMesh() { return null; } hasDepthSensing() { return false; } setAnimationLoop() {} dispose() {}
      updateCamera() {} getFoveation() {} setFoveation() {}
    }`,
  "WebGLShadowMap.js": `export function WebGLShadowMap() {
    Object.assign(this, { enabled: false, autoUpdate: true, needsUpdate: false, type: 1, render() {} });
  }`,
  "WebGLOutput.js": "export function WebGLOutput() {}",
  "WebGLUniformsGroups.js": `export function WebGLUniformsGroups() {
    Object.assign(this, { bind() {}, update() {}, dispose() {} });
  }`,
  "WebGLMorphtargets.js": "export function WebGLMorphtargets() { this.update = () => {}; }",
  "WebGLEnvironments.js": `export function WebGLEnvironments() {
    Object.assign(this, { get: () => null, dispose() {} });
  }`,
  "DFGLUTData.js": "export function getDFGLUT() { return null; }",
  "PMREMGenerator.js": "export class PMREMGenerator { fromEquirectangular() {} fromCubemap() {} dispose() {} }",
};

/** Methods that the view does not call, nor the renderer for it: three.js written to and read from JSON, rays from the
 * pointer. They are found by three.js's own layout: a method begins and ends one tab from the edge. */
const UNCALLED = /\n\t(?:toJSON|fromJSON|raycast|_computeIntersections)\([^\n]*\) \{\n[\s\S]*?\n\t\}(?=\n)/g;

export const threeReduction = {
  name: "three-reduction",
  setup(build) {
    build.onResolve({ filter: /^three$/ }, () => ({ path: join(root, "src/Three.js"), sideEffects: false }));
    const absent = new RegExp(`/(${Object.keys(ABSENT).join("|").replaceAll(".", "\\.")})$`);
    build.onLoad({ filter: absent }, ({ path }) => ({
      contents: ABSENT[basename(path)],
      resolveDir: dirname(path),
    }));
    build.onLoad(
      { filter: /three\/src\/(core|materials|math|objects|scenes|textures|cameras|lights|geometries)\/\w+\.js$/ },
      async ({ path }) => ({
        contents: (await readFile(path, "utf8")).replace(UNCALLED, ""),
      }),
    );
    const kept = reachable();
    build.onLoad({ filter: /\.glsl\.js$/ }, async ({ path }) => {
      const name = basename(path, ".glsl.js");
      const text = await readFile(path, "utf8");
      const used = (await kept).has(name) && !SPARED.test(name);
      const reduced = text.replace(/`([^`]*)`/g, (_, glsl) => JSON.stringify(used ? tight(glsl) : ""));
      return { contents: reduced };
    });
  },
};

/** Names of the shaders in use and of all that they include. */
async function reachable() {
  const seen = new Set(DIRECT);
  const visit = async (name, folder) => {
    if (seen.has(name)) return;
    seen.add(name);
    const text = await readFile(join(shaders, folder, `${name}.glsl.js`), "utf8");
    for (const [, included] of text.matchAll(/#include <(\w+)>/g)) await visit(included, "ShaderChunk");
  };
  for (const name of USED) await visit(name, "ShaderLib");
  return seen;
}

function tight(glsl) {
  return glsl
    .replace(/\/\*[\s\S]*?\*\//g, "")
    .replace(/\/\/.*$/gm, "")
    .split("\n")
    .map((line) =>
      line.trim().replace(/ ?([=+*,;(){}<>?:/-]) ?/g, (found, sign) => (line.trim().startsWith("#") ? found : sign)),
    )
    .filter(Boolean)
    .join("\n");
}
