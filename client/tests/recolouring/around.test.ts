import { expect, it } from "vitest";
import { chosenAround } from "../../src/recolouring/around";

it.each([
  ["least", Math.min, "000 000 112"],
  ["most", Math.max, "455 788 788"],
])("chooses among a pixel and those round it that there are: the %s", (_, choose, wanted) => {
  const values = Float32Array.from([3, 0, 5, 1, 4, 2, 7, 6, 8]);
  chosenAround(values, 3, choose, values, new Float32Array(9));
  const rows = [0, 3, 6].map((at) => [...values.subarray(at, at + 3)].join(""));
  expect(rows.join(" ")).toBe(wanted);
});
