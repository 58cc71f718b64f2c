import { describe, expect, it } from "vitest";
import { ResolutionLadder, fitSize, highestStep } from "../../src/viewpoint/framing";

describe("fitSize", () => {
  it.each([
    [1440, 900, 720],
    [390, 844, 512],
    [500, 500, 512],
    [3000, 400, 1024],
    [10, 4000, 256],
    [0, 0, 512],
  ])("fits %d x %d at %d in blocks of 16, at most 1024", (width, height, side) => {
    const size = fitSize(width, height, side);
    for (const length of [size.width, size.height]) {
      expect(length % 16).toBe(0);
      expect(length).toBeGreaterThanOrEqual(128);
      expect(length).toBeLessThanOrEqual(1024);
    }
  });

  it("keeps the shape and the number of pixels", () => {
    const { width, height } = fitSize(1440, 900, 512);
    expect(width / height).toBeCloseTo(1.6, 1);
    expect(Math.sqrt(width * height) / 512).toBeCloseTo(1, 1);
    expect(fitSize(700, 700, 512)).toEqual({ width: 512, height: 512 });
  });

  it("raises both sides of what would be too low", () => {
    expect(fitSize(1400, 400, 200)).toEqual({ width: 448, height: 128 });
    expect(fitSize(390, 1400, 200)).toEqual({ width: 128, height: 464 });
  });
});

describe("highestStep", () => {
  it("asks for no more pixels than the viewport has, but for the next step", () => {
    expect(highestStep(256, 256)).toBe(0);
    expect(highestStep(390, 300)).toBe(1);
    expect(highestStep(4000, 2000)).toBe(4);
  });
});

describe("ResolutionLadder", () => {
  const seconds = (ladder: ResolutionLadder, fps: number, count: number, highest = 4): number =>
    Array.from({ length: count }, () => ladder.observe(fps, highest)).filter(Boolean).length;

  it("falls when pictures come slowly, down to the smallest", () => {
    const ladder = new ResolutionLadder();
    expect(ladder.side).toBe(512);
    expect(seconds(ladder, 12, 2)).toBe(0);
    expect(seconds(ladder, 12, 1)).toBe(1);
    expect(ladder.side).toBe(384);
    seconds(ladder, 12, 60);
    expect(ladder.side).toBe(256);
  });

  it("falls to the smallest at once where most are lost, and no further where nothing is", () => {
    const ladder = new ResolutionLadder();
    for (let second = 0; second < 3; second++) ladder.observe(2, 4, true);
    expect(ladder.side).toBe(256);
    expect(seconds(ladder, 0, 60)).toBe(0);
    expect(ladder.audioOnly).toBe(false);
  });

  it("falls to audio only where even the smallest are lost, and tries again after a wait that doubles", () => {
    const ladder = new ResolutionLadder();
    const silentFor = (): number => {
      let count = 1;
      while (!ladder.observe(0, 4)) count += 1;
      return count;
    };
    const waits: number[] = [];
    for (let fall = 0; fall < 8; fall++) {
      while (!ladder.audioOnly) ladder.observe(1, 4, true);
      waits.push(silentFor());
      expect([ladder.audioOnly, ladder.side]).toEqual([false, 256]);
    }
    const settling = 2;
    expect(waits.map((wait) => wait - settling)).toEqual([6, 12, 24, 48, 96, 120, 120, 120]);
  });

  it("climbs the whole way up again, the faster the more climbs have held", () => {
    const ladder = new ResolutionLadder();
    for (let fall = 0; fall < 3; fall++) {
      while (!ladder.audioOnly) ladder.observe(1, 4, true);
      while (ladder.audioOnly) ladder.observe(0, 4);
    }
    const climbs: number[] = [];
    for (let waited = 1; ladder.side < 1024; waited++) {
      if (!ladder.observe(30, 4)) continue;
      climbs.push(waited);
      waited = 0;
    }
    expect(ladder.side).toBe(1024);
    expect(climbs).toEqual([26, 14, 8, 8]);
  });

  it("climbs when they come fluently, up to what the viewport can show", () => {
    const ladder = new ResolutionLadder();
    seconds(ladder, 30, 60, 3);
    expect(ladder.side).toBe(720);
    expect(seconds(ladder, 30, 1, 1)).toBe(1);
    expect(ladder.side).toBe(384);
  });

  it("stays where it is in between, and forgives a single slow second", () => {
    const ladder = new ResolutionLadder();
    expect(seconds(ladder, 24, 100)).toBe(0);
    for (let i = 0; i < 30; i++) ladder.observe(i % 3 === 0 ? 5 : 24, 4);
    expect(ladder.side).toBe(512);
  });

  it("waits longer after each climb that had to be taken back", () => {
    const ladder = new ResolutionLadder();
    const climbs = (count: number): number => {
      let waited = 0;
      while (!ladder.observe(30, 4)) waited += 1;
      seconds(ladder, 5, count);
      return waited;
    };
    const untilSlow = 2 + 3;
    const first = climbs(untilSlow);
    const second = climbs(untilSlow);
    expect(ladder.side).toBe(512);
    expect(second).toBeGreaterThan(1.8 * first);
  });
});
