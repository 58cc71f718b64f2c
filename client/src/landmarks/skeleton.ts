/** Lines between landmarks, as a person would draw a body. */

import type { Landmarks } from "./landmarks";

/** MediaPipe's numbers: 11-16 arms, 23-32 legs; from the viewer's side the left hand is theirs. */
const BONES: readonly (readonly [number, number])[] = [
  [11, 12], [11, 23], [12, 24], [23, 24],
  [11, 13], [13, 15], [15, 19], [12, 14], [14, 16], [16, 20],
  [23, 25], [25, 27], [27, 31], [24, 26], [26, 28], [28, 32],
]; // prettier-ignore
const HEAD: readonly number[] = [0, 2, 5, 7, 8];
const SEEN = 0.5;
const FOUND = "#7be8cf";

export interface Line {
  from: readonly [number, number];
  to: readonly [number, number];
}

/** Bones and head points that are seen, px of a picture of `width` x `height`. */
export function skeletonLines(
  seen: Landmarks,
  width: number,
  height: number,
): { lines: Line[]; points: (readonly [number, number])[] } {
  const at = (i: number): readonly [number, number] => [
    (seen.xy[2 * i] ?? 0) * width,
    (seen.xy[2 * i + 1] ?? 0) * height,
  ];
  const shown = (i: number): boolean => (seen.visibility[i] ?? 0) > SEEN;
  return {
    lines: BONES.filter(([a, b]) => shown(a) && shown(b)).map(([a, b]) => ({ from: at(a), to: at(b) })),
    points: HEAD.filter(shown).map(at),
  };
}

/** Draw `seen`, or nothing, over the whole of `canvas`. */
export function drawSkeleton(canvas: HTMLCanvasElement, seen: Landmarks | null, colour = FOUND): void {
  const pen = canvas.getContext("2d");
  if (!pen) return;
  if (seen && (canvas.width !== seen.width || canvas.height !== seen.height)) {
    canvas.width = seen.width;
    canvas.height = seen.height;
  }
  pen.clearRect(0, 0, canvas.width, canvas.height);
  if (!seen) return;
  const { lines, points } = skeletonLines(seen, canvas.width, canvas.height);
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = canvas.height / 60;
  pen.lineCap = "round";
  pen.beginPath();
  for (const { from, to } of lines) {
    pen.moveTo(...from);
    pen.lineTo(...to);
  }
  pen.stroke();
  for (const [x, y] of points) {
    pen.beginPath();
    pen.arc(x, y, pen.lineWidth, 0, 2 * Math.PI);
    pen.fill();
  }
}
