/** Orbiting a point with mouse, pen or fingers: drag turns, right button or two fingers shift, wheel or pinch zooms. */
import { Spherical, Vector3, type PerspectiveCamera } from "three";

/** Angle of a drag across the whole height, rad. */
const TURN_RAD = Math.PI;
/** Share by which a wheel step of 100 px moves nearer. */
const WHEEL = 0.12;
const NEAREST_M = 0.1;
const FARTHEST_M = 8;

export class Orbit {
  readonly target = new Vector3();
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private readonly listening = new AbortController();

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly place: HTMLElement,
    private readonly moved: () => void,
  ) {
    const { signal } = this.listening;
    place.addEventListener("pointerdown", this.press, { signal });
    place.addEventListener("pointermove", this.move, { signal });
    for (const type of ["pointerup", "pointercancel"])
      place.addEventListener(type, (event) => this.pointers.delete((event as PointerEvent).pointerId), { signal });
    place.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
    place.addEventListener("wheel", this.wheel, { signal, passive: false });
  }

  dispose(): void {
    this.listening.abort();
  }

  /** Places the camera at `from`, looking at `target`. */
  look(from: Vector3, target: Vector3): void {
    this.target.copy(target);
    this.camera.position.copy(from);
    this.camera.lookAt(target);
    this.moved();
  }

  /** Turns about the target (rad) and moves nearer by a factor. */
  turn(azimuth: number, slant: number, nearer = 1): void {
    const away = this.camera.position.clone().sub(this.target);
    // Spherical measures from +y, but the cell's upright axis is +z.
    const place = new Spherical().setFromVector3(new Vector3(away.y, away.z, away.x));
    place.theta += azimuth;
    place.phi = Math.min(Math.PI - 0.05, Math.max(0.05, place.phi + slant));
    place.radius = Math.min(FARTHEST_M, Math.max(NEAREST_M, place.radius / nearer));
    const turned = new Vector3().setFromSpherical(place);
    this.look(new Vector3(turned.z, turned.x, turned.y).add(this.target), this.target.clone());
  }

  private shift(dx: number, dy: number): void {
    const away = this.camera.position.distanceTo(this.target);
    const perPixel = (2 * away * Math.tan((this.camera.fov * Math.PI) / 360)) / this.place.clientHeight;
    const step = new Vector3(-dx * perPixel, dy * perPixel, 0).applyQuaternion(this.camera.quaternion);
    this.look(this.camera.position.clone().add(step), this.target.clone().add(step));
  }

  private readonly press = (event: PointerEvent): void => {
    this.place.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  };

  private readonly move = (event: PointerEvent): void => {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const before = Math.hypot(last.x - other.x, last.y - other.y);
      this.turn(0, 0, Math.hypot(event.clientX - other.x, event.clientY - other.y) / Math.max(before, 1));
      this.shift(dx / 2, dy / 2);
    } else if (event.buttons === 1) {
      const scale = TURN_RAD / this.place.clientHeight;
      this.turn(-dx * scale, -dy * scale);
    } else this.shift(dx, dy);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  };

  private readonly wheel = (event: WheelEvent): void => {
    event.preventDefault();
    this.turn(0, 0, Math.exp((-event.deltaY / 100) * WHEEL));
  };
}
