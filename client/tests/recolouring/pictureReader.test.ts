import { describe, expect, it } from "vitest";
import { doubled, finePicture } from "../../src/recolouring/pictureReader";

describe("doubled", () => {
  it("puts each pixel between those next to it", () => {
    const to = new Float32Array(16);
    doubled(Float32Array.of(0, 4, 8, 12), 2, to);
    expect([...to]).toEqual([0, 1, 3, 4, 2, 3, 5, 6, 6, 7, 9, 10, 8, 9, 11, 12]);
  });
});

describe("a fine picture", () => {
  it("is known where all round is inside the matte, as if that went on beyond the edge", () => {
    const side = 5;
    const data = new Uint8ClampedArray(8 * side * side).fill(255);
    data[4 * (side * side + 2 * side + 3) + 1] = 230;
    const { known } = finePicture(data, side);
    const rows = [0, 1, 2, 3, 4].map((y) => [...known.subarray(side * y, side * (y + 1))].join(""));
    expect(rows).toEqual(["11111", "11000", "11000", "11000", "11111"]);
  });
});
