/** Where a head is by its face's points; how it is turned is for motion/headRotation.ts to say. */

import type { Square } from "../look/pictureCode";
import type { Point } from "./expression";

/**
 * Those of a face's points that its expressions hardly move: forehead, temples, corners of the eyes, bridge of the
 * nose, cheekbones; as capture/detection/rigid_parts.py has them.
 */
export const HEAD_POINTS = [
  10, 151, 9, 8, 168, 6, 197, 33, 263, 133, 362, 127, 356, 234, 454, 93, 323, 54, 284,
  103, 332, 67, 297, 109, 338, 21, 251, 162, 389, 116, 345, 117, 346,
] as const; // prettier-ignore

/** A head as the picture of `timeMs` shows it. */
export interface ObservedHead {
  /** Middle of all points of the face, px of the picture. */
  middle: readonly [number, number];
  /** x right, y down, z away, px, of each of `HEAD_POINTS` as it is seen along its own line of sight. */
  points: readonly Point[];
  timeMs: number;
}

/** The head of a face found in `square` of the picture. */
export function headOf(face: readonly Point[], square: Square, timeMs: number): ObservedHead {
  const middle = [0, 1].map((c) => face.reduce((sum, point) => sum + point[c]!, 0) / face.length);
  return { middle: [square.x + middle[0]!, square.y + middle[1]!], points: HEAD_POINTS.map((i) => face[i]!), timeMs };
}
