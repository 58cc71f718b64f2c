import { describe, expect, it } from "vitest";
import type { LocalRoom } from "../../src/splats/localRoom";
import { PacedRoom, stepsFor } from "../../src/splats/pacedRoom";

const SIZE = { width: 512, height: 512 };
const VIEW = { position: [0, 1, 0], wxyz: [0, 1, 0, 0] } as const;

/** A device that takes so many milliseconds for a thousand splats. */
function device(counts: number[], msPerThousand: number) {
  const trials: number[] = [];
  const drawn: (readonly number[])[] = [];
  const sum = (kept: readonly number[]): number => kept.reduce((all, one) => all + one, 0);
  const room = {
    counts,
    lays: true,
    pelvisPositions: counts.map((_, person) => [person, 1, -1]),
    onFinished: (_: number): void => undefined,
    trialFps: (...[, , , kept]: [unknown, unknown, unknown, readonly number[]]): number => {
      trials.push(sum(kept));
      return 1e6 / (sum(kept) * msPerThousand);
    },
    draw: (...[, , , , kept]: [unknown, unknown, unknown, unknown, readonly number[]]): boolean => {
      drawn.push(kept);
      room.onFinished((sum(kept) * speed.msPerThousand) / 1000);
      return true;
    },
  };
  const speed = { msPerThousand };
  const paced = new PacedRoom(room as unknown as LocalRoom);
  const draw = (pictures: number): number => {
    for (let n = 0; n < pictures; n++) paced.draw(VIEW, 1, SIZE, false);
    return sum(drawn.at(-1) ?? []);
  };
  return { room, paced, trials, drawn, draw, speed, trial: () => paced.trial(VIEW, 1, SIZE) };
}

describe("the steps of a page", () => {
  it("are those that tell a cast apart", () => {
    const splats = (total: number): number[] => stepsFor(total).map((step) => step.splats);
    expect(splats(45_000)).toEqual([60_000, 42_000, 30_000, 21_000, 15_000, 10_000, 7_000, 5_000]);
    expect(splats(10_000)).toEqual([10_000, 7_000, 5_000]);
    expect(splats(800)).toEqual([5_000]);
  });
});

describe("PacedRoom", () => {
  it("draws all of everybody where the device is quick", () => {
    const { trial, draw, paced } = device([45_000], 0.1);
    expect(trial()).toBeGreaterThan(45);
    expect(draw(1)).toBe(45_000);
    expect([paced.atSmallest, paced.coarse]).toEqual([false, false]);
  });

  it("lays pictures on people where the device is quick, and no longer where it gets slow", () => {
    const { room, trial, draw, speed } = device([10_000], 0.5);
    trial();
    expect(room.lays).toBe(false);
    draw(30);
    expect(room.lays).toBe(true);
    speed.msPerThousand = 3;
    draw(60);
    expect(room.lays).toBe(false);
  });

  it("begins with as many splats as a slow device draws quickly enough, and never tries many more", () => {
    const { trial, draw, trials, paced } = device([45_000], 2);
    expect(trial()).toBe(50);
    expect(trials).toEqual([5_000, 7_000, 10_000, 15_000]);
    expect(draw(1)).toBe(10_000);
    expect([paced.atSmallest, paced.coarse]).toEqual([false, false]);
  });

  it("leaves people whom it could only draw coarsely to the server", () => {
    const { trial, trials, draw, paced } = device([45_000], 20);
    expect(trial()).toBe(0);
    expect(trials).toEqual([5_000]);
    expect(draw(1)).toBe(5_000);
    expect([paced.atSmallest, paced.coarse]).toEqual([true, true]);
  });

  it("draws fewer once pictures take too long, and more again when they don't", () => {
    const { trial, draw, speed, paced } = device([30_000, 15_000], 0.4);
    trial();
    expect(draw(1)).toBe(45_000);
    speed.msPerThousand = 1;
    expect(draw(350)).toBeLessThanOrEqual(33_000);
    expect([paced.atSmallest, paced.coarse]).toEqual([false, false]);
    speed.msPerThousand = 3;
    draw(300);
    expect(paced.coarse).toBe(true);
    speed.msPerThousand = 0.4;
    expect(draw(10_000)).toBe(45_000);
  });

  it("gives whoever is near more", () => {
    const { trial, draw, drawn } = device([45_000, 45_000], 1);
    trial();
    draw(1);
    const [near = 0, aside = 0] = drawn.at(-1) ?? [];
    expect(near).toBeGreaterThan(aside);
  });
});
