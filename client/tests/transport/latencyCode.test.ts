import { expect, test } from "vitest";

import { CELL_PX, COLUMNS, readLatencyCode, sinceCapture, latencyCodeCells } from "../../src/transport/latencyCode";

function corner(cells: readonly boolean[], noise = 0): Uint8ClampedArray {
  const rgba = new Uint8ClampedArray(4 * COLUMNS * CELL_PX * 2 * CELL_PX);
  for (let y = 0; y < 2 * CELL_PX; y++) {
    for (let x = 0; x < COLUMNS * CELL_PX; x++) {
      const cell = Math.floor(y / CELL_PX) * COLUMNS + Math.floor(x / CELL_PX);
      const shade = (cells[cell] ? 235 : 16) + noise * Math.sin(7 * x + 13 * y);
      rgba.fill(shade, 4 * (y * COLUMNS * CELL_PX + x), 4 * (y * COLUMNS * CELL_PX + x) + 4);
    }
  }
  return rgba;
}

test("a code is what the server writes for the same time", () => {
  // as services/live/streaming/latency_code.py has it: 12345 is 0x3039, its nibbles and 5 make 20, of which 4 stays
  const bits = "00110000001110010100";
  expect(latencyCodeCells(12345).map(Number).join("")).toBe(bits);
  expect(latencyCodeCells(12345 + 65536 * 1e6)).toEqual(latencyCodeCells(12345));
});

test.each([0, 1, 255, 4096, 65535])("%d is read back, whatever coding did to it", (value) => {
  expect(readLatencyCode(corner(latencyCodeCells(value), 60))).toBe(value);
});

test("a plain corner is no code, nor is one with a wrong cell", () => {
  expect(readLatencyCode(corner(Array<boolean>(20).fill(false)))).toBeNull();
  expect(readLatencyCode(corner(Array<boolean>(20).fill(true)))).toBeNull();
  const wrong = latencyCodeCells(777);
  wrong[3] = !wrong[3];
  expect(readLatencyCode(corner(wrong))).toBeNull();
});

test("ages survive the clock's turn", () => {
  expect(sinceCapture(65500, 65536 * 3 + 14)).toBe(50);
});
