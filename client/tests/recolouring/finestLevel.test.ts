import { describe, expect, it } from "vitest";

import { finestLevel, ofAllLevels, placesOfAllLevels } from "../../src/recolouring/finestLevel";
import { NEVER } from "../../src/splats/levels";
import { movedSplats } from "../../src/splats/moved";
import { person } from "./people";

/** Two roots; the first splits into 2 and 3, then 3 into 4 and 5. */
const FILE = {
  ...person([
    [0, 0, 0],
    [1, 0, 0],
    [2, 0, 0],
    [3, 0, 0],
    [4, 0, 0],
    [5, 0, 0],
  ]),
  levels: { fewest: 2, until: Uint32Array.of(3, NEVER, NEVER, 4, NEVER, NEVER) },
  moved: movedSplats([{ splats: Uint32Array.of(0, 2, 5), offsets: Float32Array.of(9, 9, 9, 1, 2, 3, 4, 5, 6) }], 6),
};

describe("the finest level", () => {
  it("is what no split replaces, with what moves of it", () => {
    const { splats, places } = finestLevel(FILE);
    expect([...places]).toEqual([1, 2, 4, 5]);
    expect(splats.count).toBe(4);
    expect([...splats.positions]).toEqual([1, 0, 0, 2, 0, 0, 4, 0, 0, 5, 0, 0]);
    expect([...splats.moved.splats]).toEqual([1, 3]);
    expect([...splats.moved.shapes[0]!.rows]).toEqual([0, 1]);
    expect([...splats.moved.shapes[0]!.offsets]).toEqual([1, 2, 3, 4, 5, 6]);
  });

  it("gives coarser splats the mean of theirs", () => {
    const { places } = finestLevel(FILE);
    const red = ofAllLevels(FILE, places, Float32Array.of(1, 0, 0, 0.5, 0, 0, 0.25, 0, 0, 0.75, 0, 0)).filter((_, at) => at % 3 === 0);
    expect([...red]).toEqual([0.5, 1, 0.5, 0.5, 0.25, 0.75]);
  });

  it("gives coarser splats the mean place of theirs, which weigh by their share, and its mean", () => {
    const { places } = finestLevel(FILE);
    // x, y, share of splats 1, 2, 4 and 5; the third is not seen
    const laid = Float32Array.of(10, 20, 1, 4, 8, 0.5, 7, 7, 0, 30, 60, 0.25);
    const all = [...placesOfAllLevels(FILE, places, laid)];
    expect(all.slice(9, 12)).toEqual([30, 60, 0.125]);
    expect(all.slice(3, 6)).toEqual([10, 20, 1]);
    // (4 * 0.5 + 30 * 0.125) / 0.625, and so on
    [9.2, 18.4, 0.3125].forEach((value, at) => expect(all[at]).toBeCloseTo(value, 5));
  });

  it("is all of a file without levels", () => {
    const flat = { ...FILE, levels: null };
    const { splats, places } = finestLevel(flat);
    expect(splats).toBe(flat);
    const rgb = new Float32Array(18);
    expect(ofAllLevels(flat, places, rgb)).toBe(rgb);
  });
});
