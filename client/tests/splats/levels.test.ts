import { describe, expect, it } from "vitest";
import { readSplats } from "../../src/splats/file";
import { clamped, finest, NEVER, nodesOf } from "../../src/splats/levels";
import { packSplats } from "../../src/splats/packed";
import { depths } from "../../src/splats/sort";

const ROOTS = 2;
/** Which splat each split replaces: the second root, then the first of the two in its place. */
const REPLACED = [1, 2];
const COUNT = ROOTS + REPLACED.length;
const HEAD_BYTES = 164 + 14;

/** Of version 7, on one joint: the n-th splat of all levels lies n cm up. `moved` go up as the jaw opens. */
function levelled(moved: readonly number[] = []): ArrayBuffer {
  const records = ROOTS + 2 * REPLACED.length;
  const bytes = new ArrayBuffer(HEAD_BYTES + 32 * records + 4 * REPLACED.length + 8 * 17 + 7 * moved.length);
  const data = new DataView(bytes);
  [..."MNSP"].forEach((letter, i) => data.setUint8(i, letter.charCodeAt(0)));
  data.setUint16(4, 7, true);
  data.setUint16(6, 1, true);
  data.setUint32(8, COUNT, true);
  [0, 0, 0, 1, 655.35, 1, Math.log(0.01), 0].forEach((value, i) => data.setFloat32(12 + 4 * i, value, true));
  [17, moved.length, ROOTS].forEach((value, i) => data.setUint32(152 + 4 * i, value, true));
  data.setInt16(HEAD_BYTES - 2, -1, true);
  let at = HEAD_BYTES;
  for (let n = 0; n < records; n++) {
    const split = n - ROOTS;
    if (split >= 0 && split % 2 === 0) {
      data.setUint32(at, REPLACED[split / 2] ?? 0, true);
      at += 4;
    }
    data.setUint16(at + 2, n, true);
    data.setUint8(at + 17, 255);
    data.setUint8(at + 22, 255);
    at += 32;
  }
  data.setUint32(at, moved.length, true);
  data.setFloat32(at + 4, 0.02, true);
  moved.forEach((splat, i) => {
    data.setUint32(at + 8 * 17 + 4 * i, splat, true);
    data.setInt8(at + 8 * 17 + 4 * moved.length + 3 * i + 1, 127);
  });
  return bytes;
}

const heights = (positions: Float32Array): number[] => [...positions].filter((_, i) => i % 3 === 1).map((y) => Math.round(100 * y));

describe("a file with levels", () => {
  it("has every splat of every level, in the order in which they come", () => {
    const file = readSplats(levelled([3, 5]));
    expect(heights(file.positions)).toEqual([0, 1, 2, 3, 4, 5]);
    expect(file.levels).toEqual({ fewest: 2, until: Uint32Array.of(NEVER, 3, 4, NEVER, NEVER, NEVER) });
    expect(finest(file)).toBe(4);
    expect([...file.moved.splats]).toEqual([3, 5]);
  });

  it("is a model wherever it ends", () => {
    const bytes = levelled([3, 5]);
    const coarsest = readSplats(bytes.slice(0, HEAD_BYTES + 64 + 60), 1, true);
    expect(heights(coarsest.positions)).toEqual([0, 1]);
    const next = readSplats(bytes.slice(0, HEAD_BYTES + 64 + 68), 1, true);
    expect(next.levels).toEqual({ fewest: 2, until: Uint32Array.of(NEVER, 3, NEVER, NEVER) });
    expect(next.covariances).toEqual(readSplats(bytes).covariances.slice(0, 24));
    const less = readSplats(bytes, 0.75);
    expect(less.levels).toEqual(next.levels);
    expect([...less.moved.splats]).toEqual([3]);
    expect(heights(readSplats(bytes.slice(0, HEAD_BYTES + 40), 1, true).positions)).toEqual([0]);
  });

  it("draws the level of so many splats, and others' whatever they have", () => {
    const file = readSplats(levelled());
    const cast = packSplats([file, file]);
    const rows = Float32Array.of(0, 1, 0, 1, 0, 1, 0, 1); // depth: the height and a metre
    const shown = (...kept: number[]): number[][] => {
      const depth = new Float32Array(12).fill(9);
      depths(cast.skinned, rows, depth, kept);
      const drawn = Array.from(depth.keys()).filter((i) => depth[i]! > 0);
      return [drawn.filter((i) => i < 6), drawn.filter((i) => i >= 6).map((i) => i - 6)];
    };
    expect(shown(2, 4)).toEqual([[0, 1], [0, 3, 4, 5]]);
    expect(shown(3, 0)).toEqual([[0, 2, 3], []]);
    expect(shown(1)).toEqual([[0, 1], [0, 3, 4, 5]]);
    expect(shown(Infinity, 9)).toEqual([[0, 3, 4, 5], [0, 3, 4, 5]]);
  });

  it("has levels from the coarsest to the finest", () => {
    const person = { levels: { fewest: 100 }, count: 300 };
    expect([0, 7, 150.4, 1e9].map((wanted) => clamped(person, wanted))).toEqual([0, 100, 150, 200]);
    expect([0, 7, 1e9].map((wanted) => clamped({ levels: null, count: 300 }, wanted))).toEqual([0, 7, 300]);
    expect([nodesOf(person.levels, 150), nodesOf(null, 150), nodesOf(person.levels, 0)]).toEqual([200, 150, 0]);
  });
});
