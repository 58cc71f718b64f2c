import { describe, expect, it } from "vitest";
import { LayingPace } from "../../src/splats/layingPace";

function drawn(pace: LayingPace, tookMs: number, pictures = 30): boolean {
  for (let n = 0; n < pictures; n++) pace.observe(tookMs);
  return pace.lays;
}

describe("LayingPace", () => {
  it("lays pictures on people as soon as a window of pictures was quick", () => {
    const pace = new LayingPace(30);
    expect(drawn(pace, 5, 29)).toBe(false);
    expect(drawn(pace, 5, 1)).toBe(true);
  });

  it("lays none where a processor stands in for the card", () => {
    expect(drawn(new LayingPace(30), 14, 300)).toBe(false);
  });

  it("stays with them where they make pictures slower, but not too slow", () => {
    const pace = new LayingPace(30);
    drawn(pace, 11);
    expect(drawn(pace, 21, 300)).toBe(true);
    expect(drawn(pace, 24)).toBe(false);
    expect(drawn(pace, 13, 300)).toBe(false);
  });

  it("minds no single picture that came late", () => {
    const pace = new LayingPace(30);
    for (let n = 0; n < 3; n++) drawn(pace, 1000, 1);
    expect(drawn(pace, 5, 27)).toBe(true);
    for (let n = 0; n < 14; n++) drawn(pace, 1000, 1);
    expect(drawn(pace, 5, 16)).toBe(true);
  });
});
