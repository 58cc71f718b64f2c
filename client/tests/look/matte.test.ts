import { describe, expect, it } from "vitest";
import { keptPixels, matteOf } from "../../src/look/matte";

/** The left half is the person; between, half of it; a tenth of what is right of that. */
const MASK = {
  width: 8,
  height: 4,
  values: Float32Array.from({ length: 32 }, (_, index) => [1, 1, 1, 0.5, 0.05, 0.05, 0, 0][index % 8] ?? 0),
};

describe("matteOf", () => {
  it("shows a square of the mask, and nothing of what hardly is the person", () => {
    const matte = matteOf(MASK, { x: 0, y: 0, side: 4 }, 4);
    expect([...matte.slice(0, 4)]).toEqual([255, 255, 255, 128]);
    expect([...matteOf(MASK, { x: 4, y: 0, side: 4 }, 4)]).toEqual(Array(16).fill(0));
  });

  it("is nought beyond the picture", () => {
    const matte = matteOf(MASK, { x: -2, y: -2, side: 4 }, 4);
    expect([...matte.slice(0, 8)]).toEqual(Array(8).fill(0));
    expect([...matte.slice(8, 12)]).toEqual([0, 0, 255, 255]);
  });

  it("takes the middle of each of a larger square's pixels", () => {
    expect([...matteOf(MASK, { x: 0, y: -1, side: 4 }, 2)]).toEqual([255, 128, 255, 128]);
  });
});

describe("keptPixels", () => {
  it("keeps nothing of a picture where the matte is nought, and all from one half on", () => {
    const kept = keptPixels(new Uint8ClampedArray([0, 40, 128, 255]));
    expect([0, 1, 2, 3].map((i) => kept[4 * i + 3])).toEqual([0, 80, 255, 255]);
  });
});
