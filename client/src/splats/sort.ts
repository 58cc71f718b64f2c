/** Splats by rising depth: a counting sort, as on the server. No DOM in here: it runs in a worker. */

import { clamped, nodesOf, type Levels } from "./levels";
import { TRANSFORM } from "./skeleton";

/** Splats nearer to the camera than this are not drawn, m. */
export const NEAR_M = 0.05;
/** Steps of depth that are told apart: under a millimetre over a body's depth. */
const BINS = 4096;

/** Splats a row of the order's texture. */
export const ORDER_COLUMNS = 1024;

/** Room for the order of `count` splats: whole rows. */
export function allocateOrder(count: number): Uint32Array<ArrayBuffer> {
  return new Uint32Array(ORDER_COLUMNS * Math.max(1, Math.ceil(count / ORDER_COLUMNS)));
}

/** What of the splats their depth depends on. */
export interface SkinnedPoints {
  /** Splats of each person, of all levels; people come one after the other. */
  counts: readonly number[];
  levels: readonly (Levels | null)[];
  /** x, y, z of each at rest, m. */
  positions: Float32Array;
  /** Four rows of the table of transforms each, and their weights, which sum to 255. */
  joints: Uint16Array;
  weights: Uint8Array;
  /** Those that expressions move, in the order of their offsets. */
  moved: Uint32Array;
}

/** `points` as an expression's `offsets` (four numbers each, m) move them at rest. */
export function displaced(points: SkinnedPoints, offsets: Float32Array): SkinnedPoints {
  const positions = points.positions.slice();
  points.moved.forEach((splat, row) => {
    for (let axis = 0; axis < 3; axis++) positions[3 * splat + axis]! += offsets[4 * row + axis]!;
  });
  return { ...points, positions };
}

/** Depth (m along the camera's z) as a linear function of places at rest: four numbers a joint. */
export function depthRows(transforms: Float32Array, camera: ArrayLike<number>): Float32Array {
  const joints = transforms.length / TRANSFORM;
  const rows = new Float32Array(4 * joints);
  const [a = 0, b = 0, c = 0, shift = 0] = [camera[8], camera[9], camera[10], camera[11]];
  for (let joint = 0; joint < joints; joint++) {
    for (let i = 0; i < 4; i++) {
      const at = TRANSFORM * joint + i;
      const sum = a * (transforms[at] ?? 0) + b * (transforms[at + 4] ?? 0) + c * (transforms[at + 8] ?? 0);
      rows[4 * joint + i] = i === 3 ? sum + shift : sum;
    }
  }
  return rows;
}

/** The depth of every splat, m; 0 for all but each person's level of `kept` splats, which are not drawn. */
export function depths(bound: SkinnedPoints, rows: Float32Array, out: Float32Array, kept: readonly number[] = []): void {
  let first = 0;
  bound.counts.forEach((count, person) => {
    const levels = bound.levels[person] ?? null;
    const most = clamped({ levels, count }, kept[person] ?? Infinity);
    const end = first + nodesOf(levels, most);
    depthsOf(bound, rows, out, first, end, most, levels?.until ?? null);
    out.fill(0, end, first + count);
    first += count;
  });
}

function depthsOf(
  { positions, joints, weights }: SkinnedPoints,
  rows: Float32Array,
  out: Float32Array,
  first: number,
  end: number,
  most: number,
  until: Uint32Array | null,
): void {
  for (let i = first; i < end; i++) {
    if (until && until[i - first]! <= most) {
      out[i] = 0;
      continue;
    }
    const [x, y, z] = [positions[3 * i]!, positions[3 * i + 1]!, positions[3 * i + 2]!];
    let depth = 0;
    for (let k = 4 * i; k < 4 * i + 4; k++) {
      const weight = weights[k]!;
      if (weight === 0) continue;
      const row = 4 * joints[k]!;
      depth += weight * (rows[row]! * x + rows[row + 1]! * y + rows[row + 2]! * z + rows[row + 3]!);
    }
    out[i] = depth / 255;
  }
}

/** Writes the indices of what is in front of the camera by rising depth into `order`; says how many. */
export function depthOrder(depth: Float32Array, order: Uint32Array): number {
  let low = Infinity;
  let high = -Infinity;
  for (const z of depth) {
    if (z <= NEAR_M) continue;
    if (z < low) low = z;
    if (z > high) high = z;
  }
  if (high < low) return 0;
  const scale = (BINS - 1) / Math.max(high - low, 1e-6);
  const starts = new Uint32Array(BINS + 1);
  for (const z of depth) if (z > NEAR_M) starts[Math.floor((z - low) * scale) + 1]! += 1;
  for (let bin = 0; bin < BINS; bin++) starts[bin + 1]! += starts[bin]!;
  const total = starts[BINS]!;
  for (let i = 0; i < depth.length; i++) {
    if (depth[i]! <= NEAR_M) continue;
    order[starts[Math.floor((depth[i]! - low) * scale)]!++] = i;
  }
  return total;
}
