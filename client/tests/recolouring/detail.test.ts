import { describe, expect, it } from "vitest";
import { Detail } from "../../src/recolouring/detail";

const SIDE = 8;

/** What splats come to, premultiplied: one grey of one alpha. */
function drawn(grey: number, alpha: number): Uint8Array {
  return Uint8Array.from({ length: 4 * SIDE * SIDE }, (_, at) => Math.round(255 * (at % 4 === 3 ? alpha : alpha * grey)));
}

/** The factors of a picture of one colour, of 255; known where it is said. */
function factors(rgb: readonly number[], of: Uint8Array, known: (x: number, y: number) => boolean = () => true): Float32Array {
  const rgba = Uint8ClampedArray.from({ length: 4 * SIDE * SIDE }, (_, at) => rgb[at % 4] ?? 255);
  const inside = Uint8Array.from({ length: SIDE * SIDE }, (_, at) => (known(at % SIDE, Math.floor(at / SIDE)) ? 1 : 0));
  return new Detail(SIDE).of({ side: SIDE, rgba, known: inside }, of);
}

describe("Detail", () => {
  it("is the picture by what is drawn, both a little lighter", () => {
    const [red, green, blue] = factors([102, 51, 153], drawn(0.4, 1));
    expect(red).toBeCloseTo(1, 5);
    expect(green).toBeCloseTo(0.24 / 0.44, 5);
    expect(blue).toBeCloseTo(0.64 / 0.44, 5);
  });

  it("is four at most, and a quarter at least", () => {
    const [bright] = factors([255, 255, 255], drawn(0.01, 1));
    const [dark] = factors([0, 0, 0], drawn(0.9, 1));
    expect([bright, dark]).toEqual([4, 0.25]);
  });

  it("counts as far as splats cover the picture", () => {
    const at = (alpha: number): number => factors([204, 204, 204], drawn(0.4, alpha))[0] ?? 0;
    const whole = 0.84 / 0.44;
    expect(at(0.49)).toBe(1);
    // bytes are as coarse as that
    expect(at(0.7)).toBeCloseTo(1 + 0.5 * (whole - 1), 1);
    expect(at(0.91)).toBeCloseTo(whole, 1);
    expect(at(1)).toBeCloseTo(whole, 4);
  });

  it("fades to where nothing is known, and goes on beyond the picture's edge", () => {
    const found = factors([204, 204, 204], drawn(0.4, 1), (x) => x < 4);
    const row = Array.from({ length: SIDE }, (_, x) => ((found[3 * (3 * SIDE + x)] ?? 0) - 1) / (0.84 / 0.44 - 1));
    [1, 1, 1, 0.75, 0.25, 0, 0, 0].forEach((share, x) => expect(row[x]).toBeCloseTo(share, 4));
    const corner = factors([204, 204, 204], drawn(0.4, 1), (x, y) => x + y > 0)[0] ?? 0;
    // of the sixteenths of a corner, nine are its own
    expect((corner - 1) / (0.84 / 0.44 - 1)).toBeCloseTo(7 / 16, 4);
  });

  it("says nothing of a picture of before", () => {
    const detail = new Detail(SIDE);
    const rgba = new Uint8ClampedArray(4 * SIDE * SIDE).fill(204);
    detail.of({ side: SIDE, rgba, known: new Uint8Array(SIDE * SIDE).fill(1) }, drawn(0.4, 1));
    const none = detail.of({ side: SIDE, rgba, known: new Uint8Array(SIDE * SIDE) }, drawn(0.4, 1));
    expect(new Set(none)).toEqual(new Set([1]));
  });
});
