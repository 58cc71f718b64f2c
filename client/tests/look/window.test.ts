import { describe, expect, it } from "vitest";
import type { Square } from "../../src/look/pictureCode";
import { LookWindow, type SeenPoints } from "../../src/look/window";

const [WIDTH, HEIGHT] = [640, 480];
/** Somebody at a desk: px of nose, ears, shoulders and elbows; hips and wrists are below the picture. */
const PLACES: Record<number, readonly [number, number]> = {
  0: [320, 150],
  7: [350, 145],
  8: [290, 145],
  11: [400, 260],
  12: [240, 260],
  13: [430, 400],
  14: [210, 400],
  15: [420, 540],
  16: [220, 540],
  23: [370, 620],
  24: [270, 620],
};

/** With some landmarks elsewhere; those that are not given are not seen. */
function somebody(moved: Record<number, readonly [number, number]> = {}): SeenPoints {
  const seen = { width: WIDTH, height: HEIGHT, xy: new Float32Array(66).fill(-1), visibility: new Float32Array(33) };
  for (const [i, [x, y]] of Object.entries({ ...PLACES, ...moved })) {
    seen.xy.set([x / WIDTH, y / HEIGHT], 2 * Number(i));
    seen.visibility[Number(i)] = y <= HEIGHT ? 1 : 0.1;
  }
  return seen;
}

const holds = ({ x, y, side }: Square, [px, py]: readonly [number, number]): boolean =>
  px >= x && py >= y && px <= x + side && py <= y + side;

describe("LookWindow", () => {
  it("holds head with hair, shoulders, and the trunk down to the picture's edge", () => {
    const square = new LookWindow().follow(somebody(), 0)!;
    for (const point of [[320, 95], [430, 400], [210, 400], [320, HEIGHT]] as const) expect(holds(square, point)).toBe(true);
    expect(square.side).toBeLessThanOrEqual(HEIGHT);
  });

  it("stands still while somebody hardly moves", () => {
    const window = new LookWindow();
    const first = window.follow(somebody(), 0);
    for (let step = 1; step < 60; step++) {
      const [dx, dy] = [6 * Math.sin(step), 5 * Math.cos(1.7 * step)];
      const moved = Object.fromEntries(Object.entries(PLACES).map(([i, [x, y]]) => [i, [x + dx, y + dy] as const]));
      expect(window.follow(somebody(moved), 33 * step)).toEqual(first);
    }
  });

  it("grows at once for hands that come into view, and shrinks a second after they have gone", () => {
    const window = new LookWindow();
    const first = window.follow(somebody(), 0)!;
    const hands = { 15: [610, 120], 19: [625, 100], 16: [30, 120], 20: [20, 100] } as const;
    const second = window.follow(somebody(hands), 33)!;
    expect([holds(second, [625, 100]), holds(second, [20, 100])]).toEqual([true, true]);
    expect(second.side).toBeGreaterThan(first.side);
    expect(window.follow(somebody(), 66)).toEqual(second);
    expect(window.follow(somebody(), 900)).toEqual(second);
    expect(window.follow(somebody(), 1100)!.side).toBe(first.side);
  });

  it("gives the squares of the server's own sender", () => {
    // the same as in tests/services/joining/test_window.py
    const hands = { 15: [610, 120], 19: [625, 100], 16: [30, 120], 20: [20, 100] } as const;
    const aside = Object.fromEntries(Object.entries(PLACES).map(([i, [x, y]]) => [i, [x - 150, y] as const]));
    const steps = [[0, {}], [33, hands], [66, {}], [900, {}], [1100, {}], [1133, aside]] as const;
    const window = new LookWindow();
    const squares = steps.map(([timeMs, moved]) => window.follow(somebody(moved), timeMs)!);
    expect(squares.map(({ x, y, side }) => [x, y, side])).toEqual([
      [80, 0, 480],
      [-48, -128, 736],
      [-48, -128, 736],
      [-48, -128, 736],
      [80, 0, 480],
      [0, 0, 480],
    ]);
  });

  it("moves in few steps, whatever moves", () => {
    const window = new LookWindow();
    for (let step = 0; step < 40; step++) {
      const moved = Object.fromEntries(Object.entries(PLACES).map(([i, [x, y]]) => [i, [x - 5 * step, y] as const]));
      const { x, y, side } = window.follow(somebody(moved), 33 * step)!;
      expect([Math.abs(x % 8), Math.abs(y % 8), side % 32]).toEqual([0, 0, 0]);
      expect(x).toBeGreaterThanOrEqual(-2048);
    }
  });

  it("is none while nobody's upper body is seen", () => {
    const nobody = somebody();
    nobody.visibility.fill(0.2);
    expect(new LookWindow().follow(nobody, 0)).toBeNull();
  });
});
