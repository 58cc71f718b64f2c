import { describe, expect, it } from "vitest";
import { CELLS, pictureCodeCells } from "../../src/look/pictureCode";

/** The same as in tests/services/live/test_picture_code.py, which reads it. */
const GOLDEN = "30397f4822190930000000";
const SQUARE = { x: -12, y: 34, side: 400 };

const hex = (cells: readonly boolean[]): string =>
  Array.from({ length: Math.ceil(cells.length / 8) }, (_, byte) =>
    Array.from({ length: 8 }, (_, bit) => (cells[8 * byte + bit] ? 1 : 0))
      .reduce<number>((sum, bit) => 2 * sum + bit, 0)
      .toString(16)
      .padStart(2, "0"),
  ).join("");

describe("pictureCodeCells", () => {
  it("writes the very bits that the server reads", () => {
    const cells = pictureCodeCells(12345, SQUARE);
    expect(cells).toHaveLength(CELLS * CELLS);
    expect(hex(cells)).toBe(GOLDEN);
  });

  it("tells whole milliseconds, modulo 65,536", () => {
    expect(pictureCodeCells(12345 + 65536 * 26_000_000 + 0.9, SQUARE)).toEqual(pictureCodeCells(12345, SQUARE));
  });

  it("differs wherever time, place or size do", () => {
    const codes = [
      pictureCodeCells(12345, SQUARE),
      pictureCodeCells(12346, SQUARE),
      pictureCodeCells(12345, { ...SQUARE, x: -11 }),
      pictureCodeCells(12345, { ...SQUARE, y: 35 }),
      pictureCodeCells(12345, { ...SQUARE, side: 401 }),
    ];
    expect(new Set(codes.map(hex)).size).toBe(codes.length);
  });
});
