/** The bodies of a cell as three.js objects: capsules, boxes, cones, tables, hulls; base frame, m. */
import {
  BoxGeometry,
  BufferGeometry,
  CapsuleGeometry,
  CylinderGeometry,
  Float32BufferAttribute,
  GridHelper,
  Group,
  LineBasicMaterial,
  LineSegments,
  Material,
  Matrix4,
  Mesh,
  MeshLambertMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
  type Object3D,
} from "three";
import type { Body, Scene } from "../connection/scene";

const Y = new Vector3(0, 1, 0);
const Z = new Vector3(0, 0, 1);

/** Edge of the drawn part of a half-space, m. */
const TABLE_M = 1.8;

export function matrix(rows: readonly (readonly number[])[]): Matrix4 {
  return new Matrix4().set(...(rows.flat() as Parameters<Matrix4["set"]>));
}

/** Gives an object a matrix as its pose. */
export function posed<T extends Object3D>(object: T, pose: Matrix4): T {
  object.matrixAutoUpdate = false;
  object.matrix.copy(pose);
  return object;
}

interface CapsuleLike {
  start_m: readonly number[];
  end_m: readonly number[];
  radius_m: number;
}

export function capsule({ start_m, end_m, radius_m }: CapsuleLike, material: Material): Mesh {
  const [from, to] = [new Vector3(...start_m), new Vector3(...end_m)];
  const along = to.clone().sub(from);
  const mesh = new Mesh(new CapsuleGeometry(radius_m, along.length(), 6, 18), material);
  mesh.position.copy(from).add(to).multiplyScalar(0.5);
  if (along.lengthSq() > 0) mesh.quaternion.setFromUnitVectors(Y, along.normalize());
  return mesh;
}

/** A cylinder or cone from the origin along +z. */
export function standing(foot: number, top: number, height: number, material: Material): Mesh {
  const geometry = new CylinderGeometry(top, foot, height, 40);
  geometry.rotateX(Math.PI / 2).translate(0, 0, height / 2);
  return new Mesh(geometry, material);
}

export function body(item: Body, material: Material, line: string, hulls: Map<string, BufferGeometry>): Object3D {
  switch (item.kind) {
    case "half-space": {
      const grid = new GridHelper(TABLE_M, 24, line, line);
      (grid.material as Material).opacity = 0.5;
      (grid.material as Material).transparent = true;
      grid.quaternion.copy(new Quaternion().setFromUnitVectors(Y, new Vector3(...item.normal)));
      grid.position.set(...item.point_m);
      return grid;
    }
    case "box": {
      const [x, y, z] = item.half_extents_m;
      return posed(new Mesh(new BoxGeometry(2 * x, 2 * y, 2 * z), material), matrix(item.base_from_box));
    }
    case "cone":
      return posed(
        standing(item.foot_radius_m, item.top_radius_m, item.height_m, material),
        matrix(item.base_from_cone),
      );
    case "mesh":
      return new Mesh(hulls.get(item.mesh) ?? new BufferGeometry(), material);
    default:
      return capsule(item, material);
  }
}

export function frustum({ base_from_camera, corners_m }: Scene["camera"], colour: string): LineSegments {
  const eye = [0, 1, 2].map((row) => base_from_camera[row]![3]!);
  const corners = corners_m.map((corner) => [...corner]);
  const points = corners.flatMap((corner, index) => [...eye, ...corner, ...corner, ...corners[(index + 1) % 4]!]);
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: colour, transparent: true, opacity: 0.6 }));
}

/** Circles about the dome's axis every 15°, and the cap's edge. */
export function dome({ center_m, axis, radius_m, max_slant_deg }: Scene["dome"], colour: string): LineSegments {
  const points: number[] = [];
  const turn = new Quaternion().setFromUnitVectors(Z, new Vector3(...axis));
  const center = new Vector3(...center_m);
  const at = (slant: number, azimuth: number): number[] => {
    const [s, a] = [(slant * Math.PI) / 180, (azimuth * Math.PI) / 180];
    const direction = new Vector3(Math.sin(s) * Math.cos(a), Math.sin(s) * Math.sin(a), Math.cos(s));
    return direction.applyQuaternion(turn).multiplyScalar(radius_m).add(center).toArray();
  };
  for (const slant of [15, 30, 45, 60, max_slant_deg])
    for (let azimuth = 0; azimuth < 360; azimuth += 6) points.push(...at(slant, azimuth), ...at(slant, azimuth + 6));
  for (let azimuth = 0; azimuth < 360; azimuth += 30)
    for (let slant = 0; slant < max_slant_deg - 5; slant += 5)
      points.push(...at(slant, azimuth), ...at(slant + 5, azimuth));
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: colour, transparent: true, opacity: 0.25 }));
}

/** The lamp: its head, and a translucent cone of light that is shown while the lamp is on. */
export function lamp(colour: string): Group {
  const group = new Group();
  group.add(new Mesh(new SphereGeometry(0.016, 20, 12), new MeshLambertMaterial({ color: colour, emissive: colour })));
  return group;
}
