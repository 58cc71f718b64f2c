import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { DrawTimer } from "../../src/splats/drawTimer";

/** A card that works on one picture after the other, each for so many milliseconds. */
class FakeCard {
  SYNC_GPU_COMMANDS_COMPLETE = 1;
  SYNC_STATUS = 2;
  SIGNALED = 3;
  lost = false;
  busyUntilMs = 0;
  workMs = 0;
  deleteSync = vi.fn();
  flush = (): void => undefined;
  isContextLost = (): boolean => this.lost;
  fenceSync = (): unknown => {
    this.busyUntilMs = Math.max(this.busyUntilMs, performance.now()) + this.workMs;
    return this.lost ? null : { doneMs: this.busyUntilMs };
  };
  getSyncParameter = (sync: { doneMs: number }): number => (performance.now() >= sync.doneMs ? this.SIGNALED : 0);
}

function timed(workMs: number) {
  const card = new FakeCard();
  card.workMs = workMs;
  const tookMs: number[] = [];
  const timer = new DrawTimer(card as unknown as WebGL2RenderingContext, (ms) => tookMs.push(ms));
  return { card, tookMs, timer };
}

describe("DrawTimer", () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it("tells what a picture took, however long the next one lets wait", () => {
    const { card, tookMs, timer } = timed(20);
    for (let n = 0; n < 3; n++) {
      timer.submitted(performance.now());
      vi.advanceTimersByTime(2000);
    }
    expect(tookMs).toEqual([20, 20, 20]);
    expect(card.deleteSync).toHaveBeenCalledTimes(3);
  });

  it("does not count what a picture waited for the one before", () => {
    const { tookMs, timer } = timed(24);
    for (let n = 0; n < 4; n++) timer.submitted(performance.now());
    vi.advanceTimersByTime(200);
    expect(tookMs).toEqual([24, 24, 24, 24]);
  });

  it("shares the time among pictures that are noticed at once", () => {
    const { tookMs, timer } = timed(2);
    timer.submitted(performance.now());
    timer.submitted(performance.now());
    vi.advanceTimersByTime(100);
    expect(tookMs).toEqual([2, 2]);
  });

  it("stops with the context", () => {
    const { card, tookMs, timer } = timed(20);
    timer.submitted(performance.now());
    card.lost = true;
    timer.submitted(performance.now());
    vi.advanceTimersByTime(100);
    expect([tookMs, vi.getTimerCount()]).toEqual([[], 0]);
  });
});
