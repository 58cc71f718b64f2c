/**
 * Forward kinematics: from turns of the joints to the transforms that move what is bound to them.
 *
 * A transform is three rows of four numbers, rest -> room: x_room = A x_rest + b (docs/conventions.md,
 * "skinning").
 */

import { rotationMatrix, type Vec3 } from "../viewpoint/geometry";

/** Numbers of one transform. */
export const TRANSFORM = 12;

/** A body at rest: x, y, z of each joint (m), and its parents (-1: none, else an earlier joint). */
export interface Skeleton {
  restJoints: Float32Array;
  parents: Int16Array;
}

/**
 * Writes a transform a joint into `out`, from `at` on.
 *
 * `pelvis` is where joint 0 is in the room (m); `turns` a quaternion wxyz a joint: of the pelvis in
 * the room, of every other relative to its parent.
 */
export function forwardKinematics(
  { restJoints, parents }: Skeleton,
  pelvis: ArrayLike<number>,
  rotations: ArrayLike<number>,
  out: Float32Array,
  at = 0,
): void {
  for (let joint = 0; joint < parents.length; joint++) {
    const turn = rotationMatrix([0, 1, 2, 3].map((i) => rotations[4 * joint + i] ?? 0));
    const parent = parents[joint] ?? -1;
    const own = at + TRANSFORM * joint;
    const above = at + TRANSFORM * parent;
    for (let r = 0; r < 3; r++) {
      for (let c = 0; c < 3; c++) {
        let sum = turn[3 * r + c] ?? 0;
        if (parent >= 0) {
          sum = 0;
          for (let k = 0; k < 3; k++) sum += (out[above + 4 * r + k] ?? 0) * (turn[3 * k + c] ?? 0);
        }
        out[own + 4 * r + c] = sum;
      }
    }
    // the parent carries the joint's place at rest; what is bound to the joint turns about that
    const place = parent < 0 ? pelvis : transformedJoint(out, above, restJoints, joint);
    for (let r = 0; r < 3; r++) {
      let b = place[r] ?? 0;
      for (let c = 0; c < 3; c++) b -= (out[own + 4 * r + c] ?? 0) * (restJoints[3 * joint + c] ?? 0);
      out[own + 4 * r + 3] = b;
    }
  }
}

/** Rotations of so many joints at rest. */
export function restRotations(joints: number): number[] {
  return Array.from({ length: 4 * joints }, (_, i) => (i % 4 === 0 ? 1 : 0));
}

/** Where the transform at `at` takes the place of `joint` at rest. */
export function transformedJoint(
  transforms: Float32Array,
  at: number,
  restJoints: Float32Array,
  joint: number,
): [number, number, number] {
  const [x = 0, y = 0, z = 0] = restJoints.subarray(3 * joint, 3 * joint + 3);
  return transformed(transforms, at, [x, y, z]);
}

/** Where the transform at `at` takes a place at rest. */
export function transformed(transforms: Float32Array, at: number, [x, y, z]: Vec3): [number, number, number] {
  const row = (r: number): number => {
    const [a = 0, b = 0, c = 0, d = 0] = transforms.subarray(at + 4 * r, at + 4 * r + 4);
    return a * x + b * y + c * z + d;
  };
  return [row(0), row(1), row(2)];
}

/** The place at rest that the transform at `at`, of a joint, takes to the origin. */
export function placeTakenToOrigin(transforms: Float32Array, at: number): [number, number, number] {
  const [a = 0, b = 0, c = 0, x = 0, d = 0, e = 0, f = 0, y = 0, g = 0, h = 0, i = 0, z = 0] = transforms.subarray(at, at + TRANSFORM);
  // joints only turn: the inverse is the transpose
  return [-(a * x + d * y + g * z), -(b * x + e * y + h * z), -(c * x + f * y + i * z)];
}
