import { describe, expect, it } from "vitest";
import { SAMPLE_PX, pictureQuality } from "../../src/capture/pictureQuality";

/** RGBA of grey levels. */
function picture(grey: (x: number, y: number) => number): Uint8ClampedArray {
  const pixels = new Uint8ClampedArray(4 * SAMPLE_PX * SAMPLE_PX).fill(255);
  for (let y = 0; y < SAMPLE_PX; y++) {
    for (let x = 0; x < SAMPLE_PX; x++) pixels.fill(grey(x, y), 4 * (y * SAMPLE_PX + x), 4 * (y * SAMPLE_PX + x) + 3);
  }
  return pixels;
}

describe("a picture's quality", () => {
  const stripes = (period: number) => (x: number) => 120 + 60 * Math.sin((2 * Math.PI * x) / period);

  it("is as bright as the brightest tenth: a dark face in light is no dark picture", () => {
    expect(pictureQuality(picture(() => 51)).brightness).toBeCloseTo(0.2, 5);
    expect(pictureQuality(picture((x) => (x < 54 ? 40 : 204))).brightness).toBeCloseTo(0.8, 5);
  });

  it("is sharper the finer what it shows, in light as in shade", () => {
    const [fine, coarse] = [4, 32].map((period) => pictureQuality(picture(stripes(period))).sharpness) as [number, number];
    expect(fine).toBeGreaterThan(20 * coarse);
    const shade = pictureQuality(picture((x) => stripes(4)(x) / 3)).sharpness;
    expect(shade).toBeCloseTo(fine, 1);
  });

  it("is not sharp where nothing is to be seen", () => {
    expect(pictureQuality(picture(() => 100)).sharpness).toBe(0);
  });
});
