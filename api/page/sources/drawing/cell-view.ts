/**
 * The cell in three dimensions: arm, lamp, keep-out, table, obstacles, camera, dome, lights and route.
 *
 * It draws only when something has changed. The arm follows the readings of its joints, eight a second, and moves
 * straight from one to the next, so that it neither jumps nor runs ahead of the measurement.
 *
 * A view outlives the screen that shows it, and the markers of the lights are made once. three.js numbers programs and
 * geometries for the life of the page and keeps lists as long as these numbers, so new views would fill the memory.
 */
import {
  AmbientLight,
  Box3,
  BufferGeometry,
  CanvasTexture,
  Color,
  DirectionalLight,
  DoubleSide,
  Float32BufferAttribute,
  GridHelper,
  Group,
  Line,
  LineBasicMaterial,
  Matrix4,
  Mesh,
  MeshLambertMaterial,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Scene as ThreeScene,
  SphereGeometry,
  Sprite,
  SpriteMaterial,
  Vector3,
  WebGLRenderer,
} from "three";
import { STLLoader } from "three/examples/jsm/loaders/STLLoader.js";
import type { Scene } from "../connection/scene";
import { linkPoses } from "./arm-kinematics";
import { body, capsule, dome, frustum, lamp, matrix, posed, standing } from "./cell-bodies";
import { Orbit } from "./orbit";

/** Colours of the view, from the page's style sheet. */
export type Palette = Record<"ink" | "line" | "arm" | "accent" | "warn" | "good" | "paper", string>;

/** A light to be marked: its position in the view frame, m. */
export interface MarkedLight {
  position: readonly number[];
  label: string;
  taken: boolean;
}

/** Time for drawing the arm's motion from one reading to the next, ms. */
const GLIDE_MS = 140;

/** Size of the view relative to its content when everything is to be seen. */
const MARGIN = 1.05;

export type Layer = "labels" | "candidates" | "route" | "bodies";

export class CellView {
  private readonly renderer: WebGLRenderer;
  private readonly world = new ThreeScene();
  private readonly camera = new PerspectiveCamera(40, 1, 0.01, 30);
  private readonly orbit: Orbit;
  private readonly links: Group[] = [];
  private readonly layers: Record<Layer, Group>;
  private readonly marks = new Group();
  /** Points of the dome. */
  private readonly cap: Vector3[] = [];
  private readonly ball = new SphereGeometry(0.016, 16, 10);
  private readonly surfaces: Record<"taken" | "planned", MeshLambertMaterial>;
  private readonly way: LineBasicMaterial;
  private readonly signs = new Map<string, SpriteMaterial>();
  private place: HTMLElement | null = null;
  private drawn: (frames: number) => void = () => undefined;
  private from: number[];
  private to: number[];
  private readAt = 0;
  private frame = 0;
  private readonly sizes = new ResizeObserver(() => this.resize());
  /** Number of pictures drawn so far. */
  frames = 0;

  /** Meshes are given by address. Throws Error if the browser has no WebGL. */
  constructor(
    private readonly scene: Scene,
    meshes: Map<string, ArrayBuffer>,
    private readonly palette: Palette,
  ) {
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.surfaces = {
      taken: new MeshLambertMaterial({ color: palette.good }),
      planned: new MeshLambertMaterial({ color: palette.accent }),
    };
    this.way = new LineBasicMaterial({ color: palette.accent });
    this.camera.up.set(0, 0, 1);
    this.orbit = new Orbit(this.camera, this.renderer.domElement, () => this.draw());
    this.layers = { labels: new Group(), candidates: new Group(), route: new Group(), bodies: new Group() };
    this.world.add(...Object.values(this.layers), this.marks);
    this.world.add(new AmbientLight(0xffffff, 1.3));
    for (const [x, y, z] of [
      [1, -2, 3],
      [-2, 1, 2],
    ] as const) {
      const sun = new DirectionalLight(0xffffff, 1.4);
      sun.position.set(x, y, z);
      this.world.add(sun);
    }
    this.from = this.to = [...scene.arm.home];
    this.build(meshes);
    this.pose(this.to);
    this.world.updateMatrixWorld(true);
  }

  /** Whether the view can be drawn: a browser withdraws the WebGL context when it is short of memory. */
  get usable(): boolean {
    return !this.renderer.getContext().isContextLost();
  }

  /** Shows the view in an element, everything in sight. `drawn` receives the number of pictures drawn there. */
  attach(place: HTMLElement, drawn: (frames: number) => void): void {
    if (this.place) this.detach(this.place);
    [this.place, this.drawn, this.frames, this.readAt] = [place, drawn, 0, 0];
    place.append(this.renderer.domElement);
    this.resize();
    this.fit();
    this.sizes.observe(place);
  }

  /** Takes the view out of an element, unless another element shows it by now. */
  detach(place: HTMLElement): void {
    if (this.place !== place) return;
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.sizes.disconnect();
    this.renderer.domElement.remove();
    [this.place, this.drawn] = [null, () => undefined];
  }

  /** Ends the view and releases its WebGL context. */
  close(): void {
    if (this.place) this.detach(this.place);
    this.orbit.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  /** Moves the arm to a new reading of its joints, rad; the first reading at once. */
  setJoints(joints: readonly number[]): void {
    const now = performance.now();
    if (joints.every((angle, index) => Math.abs(angle - this.to[index]!) < 1e-5)) return;
    this.from = this.readAt === 0 ? [...joints] : this.present(now);
    this.to = [...joints];
    this.readAt = now;
    this.draw();
  }

  setLights(lights: readonly MarkedLight[], route: readonly (readonly number[])[]): void {
    for (const item of this.layers.route.children) (item as Line).geometry.dispose();
    for (const group of [this.marks, this.layers.labels, this.layers.route]) group.clear();
    const toBase = matrix(this.scene.base_from_view);
    for (const { position, label, taken } of lights) {
      const ball = new Mesh(this.ball, this.surfaces[taken ? "taken" : "planned"]);
      ball.position.set(...(position as [number, number, number])).applyMatrix4(toBase);
      this.marks.add(ball);
      this.layers.labels.add(this.label(label, ball.position));
    }
    if (route.length > 1) {
      const flangeFromLamp = matrix(this.scene.tool.flange_from_lamp);
      const points = route.flatMap((joints) => {
        const flange = linkPoses(this.scene.arm.joints, joints)[6]!;
        return new Vector3().setFromMatrixPosition(flange.multiply(flangeFromLamp)).toArray();
      });
      const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
      this.layers.route.add(new Line(geometry, this.way));
    }
    this.draw();
  }

  show(layer: Layer, visible: boolean): void {
    this.layers[layer].visible = visible;
    this.draw();
  }

  /** Places the camera of the view so that arm, dome, camera and obstacles just fit. */
  fit(): void {
    const points = this.cap.map((point) => point.clone());
    for (const item of [...this.links, ...this.layers.bodies.children]) {
      if (item instanceof GridHelper) continue;
      const { min, max } = new Box3().setFromObject(item);
      for (const x of [min.x, max.x])
        for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) points.push(new Vector3(x, y, z));
    }
    const towards = new Vector3(0.45, -0.78, 0.42).normalize();
    const right = this.camera.up.clone().cross(towards).normalize();
    const up = towards.clone().cross(right);
    const middle = new Vector3();
    for (const axis of [towards, right, up]) {
      const along = points.map((point) => point.dot(axis));
      middle.addScaledVector(axis, (Math.min(...along) + Math.max(...along)) / 2);
    }
    const slope = Math.tan((this.camera.fov * Math.PI) / 360) / MARGIN;
    const distances = points.map((point) => {
      const from = point.clone().sub(middle);
      const aside = Math.max(Math.abs(from.dot(up)), Math.abs(from.dot(right)) / this.camera.aspect);
      return from.dot(towards) + aside / slope;
    });
    this.orbit.look(middle.clone().addScaledVector(towards, Math.max(...distances)), middle);
  }

  /** Turns the view about its middle, rad, and moves nearer by a factor. */
  turn(azimuth: number, slant: number, nearer?: number): void {
    this.orbit.turn(azimuth, slant, nearer);
  }

  /** Returns the present picture as a PNG. */
  picture(): Promise<Blob | null> {
    this.renderer.render(this.world, this.camera);
    return new Promise((resolve) => this.renderer.domElement.toBlob(resolve));
  }

  private build(meshes: Map<string, ArrayBuffer>): void {
    const { scene, palette } = this;
    const loader = new STLLoader();
    const surfaces = new Map([...meshes].map(([address, bytes]) => [address, loader.parse(bytes)]));
    const shell = new MeshLambertMaterial({ color: palette.arm });
    const joint = new MeshLambertMaterial({ color: palette.line });
    for (const link of scene.arm.links) {
      const group = posed(new Group(), new Matrix4());
      const surface = surfaces.get(link.mesh);
      if (surface) group.add(new Mesh(surface, link.number % 2 ? shell : joint));
      else for (const one of link.capsules) group.add(capsule(one, shell));
      this.links.push(group);
      this.world.add(group);
    }
    const bracket = new MeshLambertMaterial({ color: palette.ink });
    const flange = this.links[6]!;
    for (const one of scene.tool.capsules) flange.add(capsule(one, bracket));
    flange.add(posed(lamp(palette.warn), matrix(scene.tool.flange_from_lamp)));

    const dark = new MeshLambertMaterial({ color: palette.ink });
    const glass = new MeshLambertMaterial({ color: palette.warn, transparent: true, opacity: 0.22, side: DoubleSide });
    for (const item of scene.bodies) {
      const solid = item.role === "camera" ? dark : glass;
      this.layers.bodies.add(body(item, solid, palette.line, surfaces));
    }
    const { base_from_object, radius_m, height_m } = scene.keep_out;
    const object = new MeshLambertMaterial({
      color: palette.accent,
      transparent: true,
      opacity: 0.35,
      side: DoubleSide,
    });
    this.world.add(posed(standing(radius_m, radius_m, height_m, object), matrix(base_from_object)));
    const cap = dome(scene.dome, palette.ink);
    this.world.add(frustum(scene.camera, palette.ink), cap);
    const places = cap.geometry.getAttribute("position");
    for (let index = 0; index < places.count; index += 1)
      this.cap.push(new Vector3().fromBufferAttribute(places, index));
    this.layers.candidates.add(this.candidates());
  }

  private candidates(): Points {
    const { scene, palette } = this;
    const toBase = matrix(scene.base_from_view);
    const lights = scene.lights ?? [];
    const points = lights.flatMap(({ position }) => new Vector3(...position).applyMatrix4(toBase).toArray());
    const [good, bad] = [new Color(palette.good), new Color(palette.line)];
    const colours = lights.flatMap(({ refusal }) => (refusal ? bad : good).toArray());
    const geometry = new BufferGeometry()
      .setAttribute("position", new Float32BufferAttribute(points, 3))
      .setAttribute("color", new Float32BufferAttribute(colours, 3));
    return new Points(geometry, new PointsMaterial({ size: 0.016, vertexColors: true }));
  }

  private label(text: string, at: Vector3): Sprite {
    const sign = this.signs.get(text) ?? this.sign(text);
    this.signs.set(text, sign);
    const sprite = new Sprite(sign);
    sprite.scale.setScalar(0.06);
    sprite.position.copy(at).add(new Vector3(0, 0, 0.03));
    return sprite;
  }

  private sign(text: string): SpriteMaterial {
    const sheet = document.createElement("canvas");
    sheet.width = sheet.height = 64;
    const ink = sheet.getContext("2d")!;
    ink.font = "bold 36px system-ui, sans-serif";
    ink.textAlign = "center";
    ink.lineWidth = 8;
    ink.strokeStyle = this.palette.paper;
    ink.fillStyle = this.palette.ink;
    ink.strokeText(text, 32, 46);
    ink.fillText(text, 32, 46);
    return new SpriteMaterial({ map: new CanvasTexture(sheet), depthTest: false });
  }

  /** Joints to draw at a time, on the straight line from one reading to the next. */
  private present(now: number): number[] {
    const share = Math.min(1, (now - this.readAt) / GLIDE_MS);
    return this.to.map((angle, index) => this.from[index]! + (angle - this.from[index]!) * share);
  }

  private pose(joints: readonly number[]): void {
    linkPoses(this.scene.arm.joints, joints).forEach((pose, index) => {
      const link = this.links[index];
      if (!link) return;
      link.matrix.copy(pose);
      link.matrixWorldNeedsUpdate = true;
    });
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.place ?? {};
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private draw(): void {
    if (this.frame || !this.place) return;
    this.frame = requestAnimationFrame((now) => {
      this.frame = 0;
      this.pose(this.present(now));
      this.renderer.render(this.world, this.camera);
      this.frames += 1;
      this.drawn(this.frames);
      if (now - this.readAt < GLIDE_MS) this.draw();
    });
  }
}
