/** Directions on the dome of light positions: slant from the viewing axis and azimuth, view frame (z to the camera). */
import type { Vector3 } from "../connection/schemas";
import type { Scene } from "../connection/scene";

/** The dome in the view frame: centre and radius in m, largest slant in rad. */
export interface Dome {
  center: Vector3;
  radius: number;
  maxSlant: number;
}

export interface Direction {
  slant: number;
  azimuth: number;
}

/** The dome of a cell, from its centre in the base frame. */
export function domeOf(scene: Scene): Dome {
  const m = scene.base_from_view;
  const [x, y, z] = [0, 1, 2].map((i) => scene.dome.center_m[i]! - m[i]![3]!) as [number, number, number];
  // The inverse of a rotation is its transpose.
  const center = [0, 1, 2].map((j) => m[0]![j]! * x + m[1]![j]! * y + m[2]![j]! * z) as unknown as Vector3;
  return { center, radius: scene.dome.radius_m, maxSlant: (scene.dome.max_slant_deg * Math.PI) / 180 };
}

export function directionOf(position: readonly number[], dome: Dome): Direction {
  const [x, y, z] = [0, 1, 2].map((i) => position[i]! - dome.center[i]!) as [number, number, number];
  return { slant: Math.atan2(Math.hypot(x, y), z), azimuth: Math.atan2(y, x) };
}

/** The position on the dome in a direction, m, view frame. The slant is limited to the dome. */
export function positionAt({ slant, azimuth }: Direction, dome: Dome): Vector3 {
  const kept = Math.min(slant, dome.maxSlant);
  const across = Math.sin(kept) * dome.radius;
  const [x, y, z] = dome.center;
  return [x + across * Math.cos(azimuth), y + across * Math.sin(azimuth), z + Math.cos(kept) * dome.radius];
}
