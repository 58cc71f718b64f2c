/** Splats that a face or hand moves: where each goes at rest, before the joints carry it. */

import { EXPRESSION_COUNT } from "../landmarks/expression";

/** Of a person's splats those that move, the lowest number first. */
export interface MovedSplats {
  /** Which splats. */
  splats: Uint32Array;
  /** x, y, z for each number of an expression in turn, of each such splat; 127 is `unitM` long. */
  offsets: Int8Array;
  unitM: number;
}

/** Splats a row of the offsets' texture. */
export const MOVED_COLUMNS = 256;
const NUMBERS = 3 * EXPRESSION_COUNT;

export const NOTHING_MOVES: MovedSplats = { splats: new Uint32Array(0), offsets: new Int8Array(0), unitM: 0 };

/** Room for the offsets of `count` splats: whole rows of a texture, four numbers each. */
export function allocateOffsets(count: number): Float32Array<ArrayBuffer> {
  return new Float32Array(4 * MOVED_COLUMNS * Math.max(1, Math.ceil(count / MOVED_COLUMNS)));
}

/** Writes x, y, z (m) and nothing of each moved splat into `out`, from splat `first` on. */
export function moveSplats(
  { splats, offsets, unitM }: MovedSplats,
  expression: ArrayLike<number>,
  out: Float32Array,
  first = 0,
): void {
  for (let i = 0; i < splats.length; i++) {
    for (let axis = 0; axis < 3; axis++) {
      let sum = 0;
      for (let e = 0; e < EXPRESSION_COUNT; e++) {
        sum += (expression[e] ?? 0) * (offsets[NUMBERS * i + 3 * e + axis] ?? 0);
      }
      out[4 * (first + i) + axis] = (sum * unitM) / 127;
    }
  }
}
