/** Levels of a person's splats: any number of them, from the coarsest level to the finest, is a model. */

/** Of a replaced splat: at no number. */
export const NEVER = 0xffffffff;

export interface Levels {
  /** Splats of the coarsest level, which come first. */
  fewest: number;
  /** Of each splat of all levels, the number of splats from which two others take its place. */
  until: Uint32Array;
}

/** Splats that come before the level of `count` is whole; all of them where there are no levels. */
export function nodesOf(levels: Pick<Levels, "fewest"> | null, count: number): number {
  return levels ? Math.max(0, 2 * count - levels.fewest) : count;
}

/** What of a person's splats tells how many may be drawn. */
export interface Levelled {
  levels: Pick<Levels, "fewest"> | null;
  /** Splats of all levels. */
  count: number;
}

/** Splats of the finest level. */
export function finest({ levels, count }: Levelled): number {
  return levels ? (count + levels.fewest) / 2 : count;
}

/** The nearest number to `wanted` that there is a level of; nil stays nil: who is not drawn. */
export function clamped(person: Levelled, wanted: number): number {
  return wanted === 0 ? 0 : Math.max(person.levels?.fewest ?? 0, Math.min(Math.round(wanted), finest(person)));
}
