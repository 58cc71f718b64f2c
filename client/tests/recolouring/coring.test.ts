import { describe, expect, it } from "vitest";
import { Coring, exposureBeside } from "../../src/recolouring/coring";
import type { CutOutPicture } from "../../src/recolouring/pictureReader";

const SIDE = 16;
const AS_IT_IS = [1, 1, 1];
const ALL = Array.from({ length: SIDE * SIDE }, (_, pixel) => pixel);

/** All of it known; each pixel as grey as it is told. */
function picture(greyOf: (x: number, y: number) => number): CutOutPicture {
  return {
    side: SIDE,
    rgb: Float32Array.from(ALL.flatMap((pixel) => Array(3).fill(greyOf(pixel % SIDE, Math.floor(pixel / SIDE))))),
    known: new Float32Array(SIDE * SIDE).fill(1),
  };
}

/** The model in grey, premultiplied; null: nothing of it is there. */
function model(greyOf: (x: number, y: number) => number | null): Float32Array {
  return Float32Array.from(
    ALL.flatMap((pixel) => {
      const grey = greyOf(pixel % SIDE, Math.floor(pixel / SIDE));
      return grey === null ? [0, 0, 0, 0] : [grey, grey, grey, 1];
    }),
  );
}

function greyAt({ rgb }: CutOutPicture, x: number, y: number): number {
  return rgb[3 * (SIDE * y + x)]!;
}

describe("Coring", () => {
  it("leaves to the model what it shows within a pixel, or nearly so", () => {
    const edge = (at: number) => (x: number) => (x < at ? 0.2 : 0.8);
    const wanted = new Coring(SIDE).of(picture((x, y) => edge(9)(x) + (y % 2 ? 0.05 : -0.05)), model(edge(8)), AS_IT_IS);
    ALL.forEach((pixel) => expect(wanted.rgb[3 * pixel]).toBeCloseTo(edge(8)(pixel % SIDE), 5));
  });

  it("takes what is new, with its outline", () => {
    const isNew = (x: number, y: number): boolean => x >= 6 && x < 9 && y >= 6 && y < 9;
    const wanted = new Coring(SIDE).of(picture((x, y) => (isNew(x, y) ? 0.1 : x === 5 ? 0.46 : 0.5)), model(() => 0.5), AS_IT_IS);
    expect(greyAt(wanted, 7, 7)).toBeCloseTo(0.1, 5);
    expect(greyAt(wanted, 5, 7)).toBeCloseTo(0.46, 5);
    expect(greyAt(wanted, 5, 12)).toBeCloseTo(0.5, 5);
  });

  it("takes nothing beside a gap of the model", () => {
    const wanted = new Coring(SIDE).of(picture((x) => (x > 5 && x < 10 ? 1 : 0.3)), model((x) => (x > 6 && x < 9 ? null : 0.3)), AS_IT_IS);
    expect(greyAt(wanted, 6, 8)).toBeCloseTo(0.3, 5);
    expect(greyAt(wanted, 9, 8)).toBeCloseTo(0.3, 5);
  });
});

describe("exposureBeside", () => {
  it("is of what both show, and within what a webcam does", () => {
    const drawn = model((x) => (x < 4 ? null : 0.5));
    expect(exposureBeside(picture((x) => (x < 4 ? 1 : 0.4)), drawn)![0]).toBeCloseTo(0.8, 5);
    expect(exposureBeside(picture(() => 0.1), drawn)).toEqual([0.7, 0.7, 0.7]);
    expect(exposureBeside({ ...picture(() => 1), known: new Float32Array(SIDE * SIDE) }, drawn)).toBeNull();
  });
});
