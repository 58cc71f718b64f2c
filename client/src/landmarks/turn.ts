/** Which way head and trunk face, from the landmarks of a body in metres. */

import type { Landmarks } from "./landmarks";

/** Degrees from the camera towards the person's own left, -180 to 180. */
export interface Turn {
  head: number;
  body: number;
}

/** MediaPipe's numbers. */
const NOSE = 0;
const EARS = [7, 8] as const;
const SHOULDERS = [11, 12] as const;
const HIPS = [23, 24] as const;
/** Of somebody turned farther, the face is guessed: the head is where the trunk says, and a neck's turn more at most. */
const FACE_SEEN_DEG = 110;

export function turnOf(seen: Landmarks): Turn {
  const body = trunkTurn(seen);
  return { body, head: Math.abs(body) > FACE_SEEN_DEG ? body : headTurn(seen) };
}

/** Which side of somebody the camera sees. */
export type Side = "front" | "left" | "back" | "right";
/** In the order in which a camera that walks round to the person's left sees them, as a capture's report counts them. */
export const SIDES: readonly Side[] = ["front", "left", "back", "right"];

/** Each side is a quarter turn; whoever turns to their left shows their right. */
export function sideShown(turnDeg: number): Side {
  const quarter = Math.round(-turnDeg / 90);
  return SIDES[((quarter % 4) + 4) % 4] ?? "front";
}

/** The line from the middle of the ears to the nose. */
function headTurn(seen: Landmarks): number {
  const [left, right, nose] = [point(seen, EARS[0]), point(seen, EARS[1]), point(seen, NOSE)];
  const x = nose.x - (left.x + right.x) / 2;
  const z = nose.z - (left.z + right.z) / 2;
  return degrees(Math.atan2(x, -z));
}

/** Square to the line from right to left, of shoulders and hips together. */
function trunkTurn(seen: Landmarks): number {
  let [x, z] = [0, 0];
  for (const [left, right] of [SHOULDERS, HIPS]) {
    x += point(seen, left).x - point(seen, right).x;
    z += point(seen, left).z - point(seen, right).z;
  }
  return degrees(Math.atan2(z, x));
}

function point({ world }: Landmarks, i: number): { x: number; z: number } {
  return { x: world[3 * i] ?? 0, z: world[3 * i + 2] ?? 0 };
}

function degrees(radians: number): number {
  return (radians * 180) / Math.PI;
}
