/** Where in a camera's picture a body's landmarks say that face and hands are. */

import type { Square } from "../look/pictureCode";
import type { Landmarks } from "./landmarks";

export type Part = "face" | "left_hand" | "right_hand";

/** MediaPipe's numbers: nose to mouth; wrist, little finger, index and thumb of each hand. */
const HEAD = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10] as const;
const HANDS = { left_hand: [15, 17, 19, 21], right_hand: [16, 18, 20, 22] } as const;
/** Nose, shoulders and hips. */
const UPPER_BODY = [0, 11, 12, 23, 24] as const;
const SEEN = 0.5;
/** Half a side, in the head's landmarks' larger extent. */
const AROUND_HEAD = 1.1;
/** Hands that sign fill a smaller square, and palms are then not detected. */
const AROUND_HAND = 2.2;
/** Half a side, in the upper body's landmarks' larger extent. */
const AROUND_UPPER_BODY = 0.6;

/** A square about the part; null where it is hidden or outside of the picture. */
export function cropOf(part: Part, seen: Landmarks): Square | null {
  const head = extent(seen, HEAD);
  const size = Math.max(head.right - head.left, head.bottom - head.top);
  if (part === "face") return square(head, AROUND_HEAD * size);
  const points = HANDS[part];
  if (points.some((i) => (seen.visibility[i] ?? 0) < SEEN)) return null;
  const hand = extent(seen, points);
  const [x, y] = [(hand.left + hand.right) / 2, (hand.top + hand.bottom) / 2];
  if (x < 0 || y < 0 || x > seen.width || y > seen.height) return null;
  return square(hand, AROUND_HAND * size);
}

/** A square about the head and the trunk. */
export function upperBodySquare(seen: Landmarks): Square | null {
  const body = extent(seen, UPPER_BODY);
  return square(body, AROUND_UPPER_BODY * Math.max(body.right - body.left, body.bottom - body.top));
}

/** Which of the hands found in a crop, whose sides are 1, lies nearest to its middle; -1 of none. */
export function mostCentral(hands: readonly (readonly { x: number; y: number }[])[]): number {
  const far = hands.map((points) => {
    const [x, y] = [mean(points.map((point) => point.x)), mean(points.map((point) => point.y))];
    return Math.hypot(x - 0.5, y - 0.5);
  });
  return far.indexOf(Math.min(...far));
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

interface Extent {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

function extent({ xy, width, height }: Landmarks, points: readonly number[]): Extent {
  const x = points.map((i) => (xy[2 * i] ?? 0) * width);
  const y = points.map((i) => (xy[2 * i + 1] ?? 0) * height);
  return { left: Math.min(...x), top: Math.min(...y), right: Math.max(...x), bottom: Math.max(...y) };
}

function square({ left, top, right, bottom }: Extent, half: number): Square | null {
  const side = Math.round(2 * half);
  if (side < 2) return null;
  return { x: Math.round((left + right) / 2 - half), y: Math.round((top + bottom) / 2 - half), side };
}
