/** Splats that a face or hand moves: where each goes at rest, before the joints carry it. */

import { blendShapeWeight } from "../landmarks/expression";

/** What one blend shape, at 1, does. */
export interface BlendShape {
  /** Which of a person's splats it moves, the lowest number first. */
  splats: Uint32Array;
  /** x, y, z of each, m. */
  offsets: Float32Array;
}

/** Of a person's splats those that move. */
export interface MovedSplats {
  /** Which splats, the lowest number first. */
  splats: Uint32Array;
  /** Of each blend shape in turn: the rows of `splats` that it moves, and how far. */
  shapes: readonly { rows: Uint32Array; offsets: Float32Array }[];
}

/** Splats a row of the offsets' texture. */
export const MOVED_COLUMNS = 256;

export const NOTHING_MOVES: MovedSplats = { splats: new Uint32Array(0), shapes: [] };

/** Room for the offsets of `count` splats: whole rows of a texture, four numbers each. */
export function allocateOffsets(count: number): Float32Array<ArrayBuffer> {
  return new Float32Array(4 * MOVED_COLUMNS * Math.max(1, Math.ceil(count / MOVED_COLUMNS)));
}

/** The splats that `shapes` move, of a person who has `count`. */
export function movedSplats(shapes: readonly BlendShape[], count: number): MovedSplats {
  const rows = new Uint32Array(count);
  for (const { splats } of shapes) for (const splat of splats) rows[splat] = 1;
  const moving = Uint32Array.from(Array.from(rows.keys()).filter((splat) => rows[splat]));
  moving.forEach((splat, row) => (rows[splat] = row));
  return {
    splats: moving,
    shapes: shapes.map(({ splats, offsets }) => ({ rows: splats.map((splat) => rows[splat] ?? 0), offsets })),
  };
}

/** Writes x, y, z (m) and nothing of each moved splat into `out`, from splat `first` on. */
export function moveSplats(
  { splats, shapes }: MovedSplats,
  expression: ArrayLike<number>,
  out: Float32Array,
  first = 0,
): void {
  out.fill(0, 4 * first, 4 * (first + splats.length));
  shapes.forEach(({ rows, offsets }, shape) => {
    const value = blendShapeWeight(expression, shape);
    if (value === 0) return;
    for (let i = 0; i < rows.length; i++) {
      const to = 4 * (first + rows[i]!);
      for (let axis = 0; axis < 3; axis++) out[to + axis]! += value * offsets[3 * i + axis]!;
    }
  });
}
