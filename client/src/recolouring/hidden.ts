/** Which splats a forearm or hand hides, or may hide, and which the body does: renderer/splats/training/occlusion.py. */

import type { SplatFile } from "../splats/file";
import type { ProjectedSplats } from "./projected";

/** Elbows, wrists and hands. */
const FRONT_JOINTS = new Set([18, 19, 20, 21, 22, 23]);
const CELL_PX = 4;
/** How far beside its place a hand may be, m. */
const MARGIN_M = 0.015;
/** How much farther away a splat must be to count as hidden, m: a sleeve's own is not. */
const BEHIND_M = 0.04;
/** How much farther away than the nearest a splat must be to lie on the other side of the body, m. */
const THROUGH_M = 0.14;
const OPAQUE = 0.2;

/** 1 for each splat that moves most with a forearm, wrist or hand. */
export function limbSplats({ count, joints, weights }: SplatFile): Uint8Array {
  return Uint8Array.from({ length: count }, (_, i) => {
    let most = 4 * i;
    for (let k = most + 1; k < 4 * i + 4; k++) if (weights[k]! > weights[most]!) most = k;
    return FRONT_JOINTS.has(joints[most]!) ? 1 : 0;
  });
}

/** 1 for each splat behind `limbs` in a picture of `side` px. */
export function hiddenByLimbs(splats: ProjectedSplats, limbs: Uint8Array, side: number, focalPx: number): Uint8Array {
  const { depth } = splats;
  const hidden = new Uint8Array(limbs.length);
  const { cells, nearest, front } = nearestOf(splats, side, (i) => limbs[i] === 1);
  if (front.length === 0) return hidden;
  const reach = Math.max(1, Math.round((MARGIN_M * focalPx) / median(front) / CELL_PX));
  const around = nearestAround(nearestAround(nearest, cells, reach, 1), cells, reach, cells);
  limbs.forEach((limb, i) => {
    if (!limb && depth[i]! > 0 && depth[i]! > around[cellOf(splats, cells, i)]! + BEHIND_M) hidden[i] = 1;
  });
  return hidden;
}

/** 1 for each splat that lies through head or trunk, whatever is not of `limbs`, in a picture of `side` px. */
export function hiddenByBody(splats: ProjectedSplats, limbs: Uint8Array, side: number): Uint8Array {
  const { cells, nearest } = nearestOf(splats, side, (i) => limbs[i] === 0);
  return Uint8Array.from(splats.depth, (depth, i) =>
    depth > 0 && depth > nearest[cellOf(splats, cells, i)]! + THROUGH_M ? 1 : 0,
  );
}

/** How near the nearest of some splats is in each cell, and how near each of them is. */
function nearestOf(splats: ProjectedSplats, side: number, counts: (i: number) => boolean) {
  const { depth, opacity } = splats;
  const cells = Math.ceil(side / CELL_PX);
  const nearest = new Float32Array(cells * cells).fill(Infinity);
  const front: number[] = [];
  depth.forEach((far, i) => {
    if (far === 0 || opacity[i]! <= OPAQUE || !counts(i)) return;
    const cell = cellOf(splats, cells, i);
    nearest[cell] = Math.min(nearest[cell]!, far);
    front.push(far);
  });
  return { cells, nearest, front };
}

function cellOf({ x, y }: ProjectedSplats, cells: number, i: number): number {
  return cells * cellAt(y[i]!, cells) + cellAt(x[i]!, cells);
}

function cellAt(px: number, cells: number): number {
  return Math.max(0, Math.min(cells - 1, Math.trunc(px / CELL_PX)));
}

function median(values: number[]): number {
  values.sort((a, b) => a - b);
  const middle = values.length >> 1;
  return values.length % 2 ? values[middle]! : 0.5 * (values[middle - 1]! + values[middle]!);
}

/** The least of each cell and those up to `reach` beside it, along rows (`step` 1) or columns. */
function nearestAround(of: Float32Array, cells: number, reach: number, step: number): Float32Array {
  return of.map((_, at) => {
    const along = Math.floor(at / step) % cells;
    let least = Infinity;
    for (let n = Math.max(-reach, -along); n <= Math.min(reach, cells - 1 - along); n++) {
      least = Math.min(least, of[at + n * step]!);
    }
    return least;
  });
}
