import { describe, expect, it } from "vitest";
import { shareBudget, sizeInView, SplatBudget, SplatShares, steadyShares } from "../../src/splats/budget";
import { passCamera } from "../../src/splats/camera";

const PACE = 1000 / 30;

describe("SplatBudget by what pictures take", () => {
  const STEPS = [{ splats: 40 }, { splats: 20 }, { splats: 10 }];
  const made = (first: number) => new SplatBudget({ steps: STEPS, first, paceMs: PACE, late: 1, window: 30 });
  const run = (budget: SplatBudget<{ splats: number }>, pictures: number, tookMs: number): void => {
    for (let n = 0; n < pictures; n++) budget.observe(tookMs);
  };

  it("begins where it is told to, and steps down once a window is late", () => {
    const budget = made(1);
    run(budget, 29, 1.1 * PACE);
    expect(budget.step.splats).toBe(20);
    run(budget, 1, 1.1 * PACE);
    expect([budget.step.splats, budget.atSmallest]).toEqual([10, true]);
    run(budget, 300, 10 * PACE);
    expect(budget.step.splats).toBe(10);
  });

  it("steps up to the most splats while pictures take little, however rarely they come", () => {
    const budget = made(2);
    run(budget, 6 * 30, 0.5 * PACE);
    expect(budget.step.splats).toBe(20);
    run(budget, 60 * 30, 0.5 * PACE);
    expect([budget.step.splats, budget.atSmallest]).toEqual([40, false]);
  });
});

describe("shares of a budget", () => {
  it("go by size in view, and what somebody has not got goes to the others", () => {
    expect(shareBudget([9000, 9000], [1, 1], 60_000)).toEqual([9000, 9000]);
    expect(shareBudget([10_000, 10_000], [3, 1], 8000)).toEqual([6000, 2000]);
    expect(shareBudget([4000, 10_000, 10_000], [6, 1, 1], 8000)).toEqual([4000, 2000, 2000]);
    expect(shareBudget([10_000, 10_000], [0, 1], 8000)).toEqual([0, 8000]);
    expect(shareBudget([], [], 8000)).toEqual([]);
  });

  it("stay as they are for small changes, unless they are too many", () => {
    const before = [6000, 2000];
    expect(steadyShares(before, [5800, 2200], 8000)).toBe(before);
    expect(steadyShares(before, [4000, 4000], 8000)).toEqual([4000, 4000]);
    expect(steadyShares(before, [5800, 2000], 7800)).toEqual([5800, 2000]);
    expect(steadyShares(before, [6000], 8000)).toEqual([6000]);
  });

  it("see those near and ahead as larger", () => {
    const camera = passCamera({ position: [0, 1.6, 0], wxyz: [0, 1, 0, 0] }, 1, 100, 100);
    const ahead = sizeInView(camera, [0, 1, -2]);
    expect(ahead / sizeInView(camera, [0, 1, -4])).toBeCloseTo((16 + 0.36) / (4 + 0.36), 5);
    expect(sizeInView(camera, [0, 1, 2])).toBeLessThan(0.2 * ahead);
  });

  const seen = (z: number, height = 1000) => passCamera({ position: [0, 1, z], wxyz: [0, 1, 0, 0] }, 1, height, height);

  it("follow the camera a little with each picture", () => {
    const room = { counts: [10_000, 10_000], pelvisPositions: [[0, 1, -2], [0, 1, 2]] as const };
    const shares = new SplatShares();
    const [first = 0, second = 0] = shares.of(room, seen(0), 8000);
    expect(first).toBeGreaterThan(5 * second);
    expect(shares.of(room, seen(0.01), 8000)).toEqual([first, second]);
    const [less = 0, more = 0] = shares.of(room, seen(3), 8000);
    expect(less).toBe(first - Math.floor(0.05 * first));
    expect(more).toBe(second + Math.max(50, Math.floor(0.05 * second)));
    expect(shares.settled).toBe(false);
    for (let picture = 0; picture < 120; picture++) shares.of(room, seen(3), 8000);
    const [far = 0, near = 0] = shares.of(room, seen(3), 8000);
    expect(near).toBeGreaterThan(5 * far);
    expect(shares.settled).toBe(true);
    expect(shares.of(room, seen(0), 8000, true)).toEqual([first, second]);
  });

  it("are no more than show at somebody's size", () => {
    const room = { counts: [60_000], pelvisPositions: [[0, 1, -4]] as const };
    const [small = 0] = new SplatShares().of(room, seen(0, 200), 60_000);
    const [large = 0] = new SplatShares().of(room, seen(0, 400), 60_000);
    expect(large / small).toBeCloseTo(4, 2);
    expect(small).toBeLessThan(2000);
    const shares = new SplatShares();
    expect(shares.of(room, seen(0, 2000), 60_000)).toEqual([60_000]);
    expect(shares.worth).toBe(60_000);
  });
});
