/** Heights along a line across a result, mm, from the depth map and the camera's intrinsics. */
import type { Scene } from "../connection/scene";
import type { FloatMap } from "./float-tiff";
import type { Point } from "./region-drawing";

export interface Profile {
  /** Distance along the line, mm. */
  along: number[];
  /** Height towards the camera above the profile's lowest point, mm; null where there is no surface. */
  height: (number | null)[];
}

/** Maximum number of points of a profile. */
const MOST_POINTS = 600;

export function profileOf(depth: FloatMap, from: Point, to: Point, camera: Scene["camera"]): Profile {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
  const steps = Math.max(2, Math.min(MOST_POINTS, Math.round(length)));
  // A map whose size differs from the camera's images is a reduced one.
  const scale = camera.width_px / depth.width;
  const [fx, fy, cx, cy] = [
    camera.camera_matrix[0][0],
    camera.camera_matrix[1][1],
    camera.camera_matrix[0][2],
    camera.camera_matrix[1][2],
  ];
  const points: ([number, number, number] | null)[] = [];
  for (let step = 0; step <= steps; step += 1) {
    const u = Math.round(from[0] + ((to[0] - from[0]) * step) / steps);
    const v = Math.round(from[1] + ((to[1] - from[1]) * step) / steps);
    const index = v * depth.width + u;
    const z = depth.values[index];
    const solved = u >= 0 && v >= 0 && u < depth.width && v < depth.height && z && Number.isFinite(z);
    points.push(solved ? [((u * scale - cx) / fx) * z, ((v * scale - cy) / fy) * z, z] : null);
  }
  const first = points.find((point) => point !== null);
  if (!first) return { along: [], height: [] };
  const lowest = Math.max(...points.flatMap((point) => (point ? [point[2]] : [])));
  const unit = [to[0] - from[0], to[1] - from[1]].map((part) => part / length) as [number, number];
  const kept = points.map((point) =>
    point ? { at: ((point[0] - first[0]) * unit[0] + (point[1] - first[1]) * unit[1]) * 1e3, z: point[2] } : null,
  );
  const begin = kept.findIndex((one) => one !== null);
  const end = kept.findLastIndex((one) => one !== null);
  let last = 0;
  const along: number[] = [];
  const height: (number | null)[] = [];
  for (const one of kept.slice(begin, end + 1)) {
    last = one ? Math.max(one.at, last) : last;
    along.push(last);
    height.push(one ? (lowest - one.z) * 1e3 : null);
  }
  return { along, height };
}
