import { describe, expect, it } from "vitest";
import { lower } from "../../src/look/keying";
import { finePicture } from "../../src/recolouring/pictureReader";

describe("lower", () => {
  it("gives a person their colours, and black nothing", () => {
    const sent = Uint8ClampedArray.of(255, 36, 145, 255, 0, 0, 0, 255, 12, 12, 12, 255, 20, 20, 20, 255);
    const matte = new Float32Array(4);
    lower(sent, matte);
    expect([...sent.subarray(0, 3)]).toEqual([255, 0, 127]);
    expect([...matte].map(Math.round)).toEqual([255, 0, 0, 128]);
  });
});

describe("a fine picture", () => {
  it("is known where all round is inside the matte, as if that went on beyond the edge", () => {
    const side = 5;
    const data = new Uint8ClampedArray(4 * side * side).fill(255);
    data.fill(26, 4 * (2 * side + 3), 4 * (2 * side + 3) + 3);
    const { known } = finePicture(data, side);
    const rows = [0, 1, 2, 3, 4].map((y) => [...known.subarray(side * y, side * (y + 1))].join(""));
    expect(rows).toEqual(["11111", "11000", "11000", "11000", "11111"]);
  });
});
