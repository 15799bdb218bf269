/** Forward kinematics of the arm from its Denavit–Hartenberg rows: pose of each link in the base frame. */
import { Matrix4 } from "three";
import type { Scene } from "../connection/scene";

/** Poses of links 0 (the base) to 6 (the flange) at joints `q` (6, rad): Rz(q + theta) · Tz(d) · Tx(a) · Rx(alpha). */
export function linkPoses(rows: Scene["arm"]["joints"], q: readonly number[]): Matrix4[] {
  const poses = [new Matrix4()];
  rows.forEach(({ theta_rad, a_m, d_m, alpha_rad }, joint) => {
    const turn = new Matrix4().makeRotationZ(q[joint]! + theta_rad);
    const shift = new Matrix4().makeTranslation(a_m, 0, d_m);
    const tilt = new Matrix4().makeRotationX(alpha_rad);
    poses.push(poses[joint]!.clone().multiply(turn).multiply(shift).multiply(tilt));
  });
  return poses;
}
