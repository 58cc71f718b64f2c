/** Which square of the webcam's picture is sent: round head, trunk and hands, and still while they hardly move. */

import type { Square } from "./pictureCode";

/** As much of a picture's landmarks as is needed; see `Landmarks`. */
export interface SeenPoints {
  width: number;
  height: number;
  xy: Float32Array;
  visibility: Float32Array;
}

/** MediaPipe's numbers, from the nose to the hips. */
const UPPER_BODY = Array.from({ length: 25 }, (_, index) => index);
const HEAD = 11;
/** Shoulders and hips: where they are hidden, a desk or the picture's edge cuts the trunk off below. */
const TRUNK = new Set([11, 12, 23, 24]);
const SEEN = 0.5;
/** Hair begins so far above the eyes, in the extent of the face's landmarks. */
const ABOVE_EYES = 0.9;
/** Sleeves, fingers and hair beyond the landmarks, in the larger side of their box. */
const MARGIN = 0.06;
/** A new square leaves so much room that the next one is not needed soon. */
const ROOM = 1.15;
/** A square that could be smaller than this share of its side, for so long, is made smaller. */
const LOOSE = 0.75;
const LOOSE_MS = 1000;
/** px. */
const SIDE_STEP = 32;
const PLACE_STEP = 8;

interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

export class LookWindow {
  private square: Square | null = null;
  private looseSinceMs: number | null = null;

  /** The square for the picture of `timeMs`; null while nothing of an upper body is seen. */
  follow(seen: SeenPoints, timeMs: number): Square | null {
    const box = boxOf(seen);
    if (!box) return null;
    const next = squareAround(box, seen);
    const held = this.square;
    const loose = held !== null && next.side < LOOSE * held.side;
    this.looseSinceMs = loose ? (this.looseSinceMs ?? timeMs) : null;
    const tooLoose = this.looseSinceMs !== null && timeMs - this.looseSinceMs >= LOOSE_MS;
    if (held && holds(held, box) && !tooLoose) return held;
    this.looseSinceMs = null;
    return (this.square = next);
  }
}

/** What of the picture shows head, trunk and hands. */
function boxOf({ xy, visibility, width, height }: SeenPoints): Box | null {
  const points = UPPER_BODY.map((i) => ({ i, x: (xy[2 * i] ?? 0) * width, y: (xy[2 * i + 1] ?? 0) * height }));
  const shown = points.filter(({ i, x, y }) => {
    const inside = x >= 0 && y >= 0 && x <= width && y <= height;
    return TRUNK.has(i) || (inside && (visibility[i] ?? 0) >= SEEN);
  });
  if (!shown.some(({ i }) => (visibility[i] ?? 0) >= SEEN)) return null;
  const box = extent(shown);
  const face = shown.filter(({ i }) => i < HEAD);
  if (face.length > 0) {
    const { left, top, right, bottom } = extent(face);
    box.top = Math.min(box.top, top - ABOVE_EYES * Math.max(right - left, bottom - top));
  }
  const margin = MARGIN * Math.max(box.right - box.left, box.bottom - box.top);
  return {
    left: clamped(box.left - margin, 0, width),
    top: clamped(box.top - margin, 0, height),
    right: clamped(box.right + margin, 0, width),
    bottom: clamped(box.bottom + margin, 0, height),
  };
}

function extent(points: readonly { x: number; y: number }[]): Box {
  const [x, y] = [points.map((point) => point.x), points.map((point) => point.y)];
  return { left: Math.min(...x), top: Math.min(...y), right: Math.max(...x), bottom: Math.max(...y) };
}

function squareAround({ left, top, right, bottom }: Box, { width, height }: SeenPoints): Square {
  const needed = Math.max(right - left, bottom - top, 1);
  const roomy = SIDE_STEP * Math.ceil((ROOM * needed) / SIDE_STEP);
  // beyond the picture there is nothing to have room for
  const shorter = Math.min(width, height);
  const side = needed <= shorter ? Math.min(roomy, shorter) : roomy;
  return { x: placed((left + right) / 2, side, width), y: placed((top + bottom) / 2, side, height), side };
}

/** Where a square about `middle` begins: inside of the picture where it fits, else about the picture. */
function placed(middle: number, side: number, most: number): number {
  const start = side <= most ? clamped(middle - side / 2, 0, most - side) : (most - side) / 2;
  return PLACE_STEP * Math.floor(start / PLACE_STEP);
}

function holds({ x, y, side }: Square, { left, top, right, bottom }: Box): boolean {
  return left >= x && top >= y && right <= x + side && bottom <= y + side;
}

function clamped(value: number, low: number, high: number): number {
  return Math.max(low, Math.min(high, value));
}
