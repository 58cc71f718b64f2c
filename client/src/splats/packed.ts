/** Several people's splats packed into one table: what the shader reads, and what sorting reads. */

import type { SplatFile } from "./file";
import type { SkinnedPoints } from "./sort";

/** Splats drawn at once; beyond, everybody gives the least important of theirs. */
export const MAX_SPLATS = 60_000;
/** Numbers a splat in the shader's table: four texels of four. */
export const SPLAT_NUMBERS = 16;
export const OWNER_BITS = 8;

export interface PackedSplats {
  people: readonly SplatFile[];
  count: number;
  /** Rows of the table of transforms: joints of all. */
  joints: number;
  skinned: SkinnedPoints;
  /** Splats that faces and hands move, of all; each person's come one after the other. */
  moved: number;
  /**
   * Four texels a splat: place, joints | xx xy xz yy | yz zz, joints, weights | surface, owner and,
   * above its `OWNER_BITS`, one more than its row among the moved; nil: it does not move.
   */
  table: Uint32Array;
}

/** Which share of their splats everybody gives so that all stay within the budget. */
export function shareWithin(counts: readonly number[], most = MAX_SPLATS): number {
  return Math.min(1, most / Math.max(1, counts.reduce((sum, count) => sum + count, 0)));
}

export function packSplats(people: readonly SplatFile[]): PackedSplats {
  const count = people.reduce((sum, person) => sum + person.count, 0);
  const bound: SkinnedPoints = {
    counts: people.map((person) => person.count),
    levels: people.map(({ levels }) => levels),
    positions: new Float32Array(3 * count),
    joints: new Uint16Array(4 * count),
    weights: new Uint8Array(4 * count),
    moved: Uint32Array.from(people.flatMap(({ moved }, person) => {
      const before = people.slice(0, person).reduce((sum, earlier) => sum + earlier.count, 0);
      return Array.from(moved.splats, (splat) => before + splat);
    })),
  };
  const table = new Uint32Array(SPLAT_NUMBERS * count);
  let first = 0;
  let joints = 0;
  let moved = 0;
  for (const [owner, person] of people.entries()) {
    bound.positions.set(person.positions, 3 * first);
    bound.weights.set(person.weights, 4 * first);
    for (let k = 0; k < 4 * person.count; k++) bound.joints[4 * first + k] = joints + person.joints[k]!;
    fillTable(person, owner, bound.joints.subarray(4 * first), table.subarray(SPLAT_NUMBERS * first));
    for (const splat of person.moved.splats) {
      table[SPLAT_NUMBERS * (first + splat) + SPLAT_NUMBERS - 1]! |= ++moved << OWNER_BITS;
    }
    first += person.count;
    joints += person.parents.length;
  }
  return { people, count, joints, skinned: bound, moved, table };
}

function fillTable(person: SplatFile, owner: number, joints: Uint16Array, table: Uint32Array): void {
  const floats = new Float32Array(table.buffer, table.byteOffset, table.length);
  for (let i = 0; i < person.count; i++) {
    const at = SPLAT_NUMBERS * i;
    floats.set(person.positions.subarray(3 * i, 3 * i + 3), at);
    floats.set(person.covariances.subarray(6 * i, 6 * i + 6), at + 4);
    // two joints of up to 4096 and the capture weight share a number each with what is left of 32 bits
    const [a, b, c, d] = [joints[4 * i]!, joints[4 * i + 1]!, joints[4 * i + 2]!, joints[4 * i + 3]!];
    table[at + 3] = a | (b << 16);
    table[at + 10] = c | (d << 16);
    const [p, q, r, s] = person.weights.subarray(4 * i, 4 * i + 4);
    table[at + 11] = p! | (q! << 8) | (r! << 16) | (s! << 24);
    table.set([...surface(person, i), owner], at + 12);
  }
}

/** Colour and capture weight, albedo and opacity, normal: a byte each, the first lowest. */
function surface({ colours, albedos, normals, captureWeights, opacities }: SplatFile, i: number): number[] {
  const three = (of: Uint8Array | Int8Array): number =>
    (of[3 * i]! & 255) | ((of[3 * i + 1]! & 255) << 8) | ((of[3 * i + 2]! & 255) << 16);
  return [three(colours) | (captureWeights[i]! << 24), three(albedos) | (opacities[i]! << 24), three(normals)];
}
