import { describe, expect, it } from "vitest";
import { nearest, type Box } from "../../src/views/arrowFocus";

const at = (x: number, y: number): Box => ({ x, y, width: 10, height: 10 });

describe("nearest", () => {
  const [left, right, above, farAbove] = [at(0, 100), at(200, 100), at(110, 0), at(100, -300)];
  const boxes = [left, right, above, farAbove];

  it("goes to what lies in the direction of the arrow", () => {
    expect(nearest(at(100, 100), boxes, "ArrowLeft")).toBe(0);
    expect(nearest(at(100, 100), boxes, "ArrowRight")).toBe(1);
    expect(nearest(at(100, 100), boxes, "ArrowUp")).toBe(2);
  });

  it("goes nowhere where nothing lies", () => {
    expect(nearest(at(100, 100), boxes, "ArrowDown")).toBe(-1);
    expect(nearest(at(0, 0), [], "ArrowLeft")).toBe(-1);
  });

  it("prefers what lies in line to what is nearer but aside", () => {
    expect(nearest(at(0, 0), [at(30, 60), at(90, 5)], "ArrowRight")).toBe(1);
  });
});
