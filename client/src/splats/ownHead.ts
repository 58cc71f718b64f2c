/** Whoever looks through somebody's eyes sees the others, not the inside of that head. No DOM in here. */

import { transformedJoint, TRANSFORM, type Skeleton } from "./skeleton";

/** Whose head is so near to the eye is not drawn, however they lean and even from a little behind it; as on the server (renderer/scene_renderer.py), m. */
const OWN_HEAD_M = 0.6;
const HEAD = 15;

/** Splats to draw of each of `people`: as `kept` says, but none of whoever's head holds `eye`. */
export function withoutOwnHead(
  people: readonly Skeleton[],
  transforms: Float32Array,
  eye: readonly [number, number, number],
  kept: readonly number[],
): number[] {
  let at = 0;
  return people.map((person, index) => {
    const [x, y, z] = transformedJoint(transforms, at + TRANSFORM * HEAD, person.restJoints, HEAD);
    at += TRANSFORM * person.parents.length;
    return Math.hypot(x - eye[0], y - eye[1], z - eye[2]) < OWN_HEAD_M ? 0 : (kept[index] ?? Infinity);
  });
}
