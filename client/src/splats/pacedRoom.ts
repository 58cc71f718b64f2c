/** A room on a page: as many splats as this device draws in time. */

import type { Size } from "../viewpoint/framing";
import type { CameraPose } from "../viewpoint/viewpoint";
import { SplatBudget, SplatShares, type Step } from "./budget";
import type { LocalRoom } from "./localRoom";
import { passCamera } from "./camera";
import { LayingPace } from "./layingPace";
import { ENOUGH_FPS } from "./renderMode";

/** Splats of all people together. */
const STEPS: readonly Step[] = [60_000, 42_000, 30_000, 21_000, 15_000, 10_000, 7_000, 5_000].map((splats) => ({ splats }));
const PACE_MS = 1000 / 30;
/** Pictures that are judged together. */
const WINDOW = 30;
/** With fewer of a person's splats, a larger picture shows no more of them. */
const PLAIN = 10_000;

/** The steps that tell people of `total` splats apart, the most splats first. */
export function stepsFor(total: number): readonly Step[] {
  return STEPS.filter((_, at) => (STEPS[at + 1]?.splats ?? 0) < total);
}

export class PacedRoom {
  private budget: SplatBudget<Step> | null = null;
  private readonly shares = new SplatShares();
  private readonly layingPace = new LayingPace(PACE_MS);

  /** `onFinished`: a picture is finished. */
  constructor(
    private readonly room: LocalRoom,
    onFinished: () => void = () => undefined,
  ) {
    room.lays = this.layingPace.lays;
    room.onFinished = (tookMs) => {
      if (this.shares.settled) this.budget?.observe(tookMs);
      this.layingPace.observe(tookMs);
      room.lays = this.layingPace.lays;
      onFinished();
    };
  }

  /** Fewer splats than these would not be drawn. */
  get atSmallest(): boolean {
    return this.budget?.atSmallest ?? true;
  }

  /** People are drawn so coarsely that larger pictures are of no use. */
  get coarse(): boolean {
    return this.budget !== null && this.budget.step.splats < Math.min(this.shares.worth, PLAIN * this.room.counts.length);
  }

  /**
   * Begin with the most splats that this device draws quickly enough, the fewest first: a slow device
   * is not held up by what it can't draw. Returns the pictures a second at that step; nil where people
   * would be coarse, whom a server shows whole.
   */
  trial(view: CameraPose, fovYRad: number, size: Size): number {
    const steps = stepsFor(sum(this.room.counts));
    const tried = new SplatShares();
    const camera = passCamera(view, fovYRad, size.width, size.height);
    const fpsAt = (at: number): number => {
      const kept = tried.of(this.room, camera, steps[at]?.splats ?? 0, true);
      return this.room.trialFps(view, fovYRad, size, kept, ENOUGH_FPS);
    };
    let first = steps.length - 1;
    let fps = fpsAt(first);
    while (fps >= ENOUGH_FPS && first > 0) {
      const next = fpsAt(first - 1);
      if (next < ENOUGH_FPS) break;
      first -= 1;
      fps = next;
    }
    this.budget = new SplatBudget({ steps, first, paceMs: PACE_MS, late: 1, window: WINDOW });
    this.shares.of(this.room, camera, this.budget.step.splats);
    return this.coarse ? 0 : fps;
  }

  /** Draw what has changed since the last time; says whether a picture was drawn. */
  draw(view: CameraPose, fovYRad: number, size: Size, hideUnseen: boolean): boolean {
    const kept = this.shares.of(this.room, passCamera(view, fovYRad, size.width, size.height), this.budget?.step.splats ?? 0);
    return this.room.draw(view, fovYRad, size, hideUnseen, kept);
  }
}

function sum(counts: readonly number[]): number {
  return counts.reduce((all, count) => all + count, 0);
}
