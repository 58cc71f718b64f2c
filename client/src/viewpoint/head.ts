/** Where heads are, for voices that come from them: of somebody of usual height who stands. */

import type { Vec3 } from "./geometry";

const PELVIS_M = 0.95;
const HEAD_ABOVE_PELVIS_M = 0.65;

/** The head of somebody whose pelvis is there, m. */
export function headAbove([x, y, z]: readonly [number, number, number]): Vec3 {
  return [x, y + HEAD_ABOVE_PELVIS_M, z];
}

/** The pelvis of somebody who stands at that place on the floor, m. */
export function pelvisAt([x, y, z]: readonly [number, number, number]): Vec3 {
  return [x, y + PELVIS_M, z];
}
