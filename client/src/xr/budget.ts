/**
 * How many splats a headset draws, so that no picture comes late: steps by measured time between
 * pictures, and each step shared among people by their size in view. No DOM in here.
 */

import type { PassCamera } from "../splats/pass";

/** What one step draws: splats of all together, the eyes' sides (of the whole), and how coarse their rims are. */
export interface Step {
  splats: number;
  viewportScale: number;
  foveation: number;
}

export const STEPS: readonly Step[] = [
  { splats: 60_000, viewportScale: 1, foveation: 0 },
  { splats: 42_000, viewportScale: 1, foveation: 0.2 },
  { splats: 30_000, viewportScale: 1, foveation: 0.4 },
  { splats: 21_000, viewportScale: 0.9, foveation: 0.6 },
  { splats: 15_000, viewportScale: 0.8, foveation: 0.8 },
  { splats: 10_000, viewportScale: 0.7, foveation: 1 },
  { splats: 7_000, viewportScale: 0.6, foveation: 1 },
  { splats: 5_000, viewportScale: 0.5, foveation: 1 },
];
const FIRST_STEP = 2;
/** Pictures that are judged together: half a second at 72 a second. */
const WINDOW = 36;
/** A picture is late from so many times the pace on: headsets leave out whole ones. */
const LATE = 1.4;
/** Late ones in a window that make it step down; with as many as `CALM` it may step up again. */
const TOO_LATE = 8;
const CALM = 1;
/** Pictures that take so many times the pace on average need no finding out step by step. */
const FAR_TOO_SLOW = 2.5;
/** Calm windows before the next step up; twice as many each time that one was a mistake. */
const PATIENCE = 6;
const MOST_PATIENCE = 96;
/** A step down so soon after one up shows that it was a mistake, windows. */
const REGRET = 4;
/** The headset was taken off, or the page was away, ms. */
const AWAY_MS = 500;

export class SplatBudget {
  private at = FIRST_STEP;
  private lastMs: number | null = null;
  private pictures = 0;
  private late = 0;
  private lateMs = 0;
  private calm = 0;
  private patience = PATIENCE;
  private sinceUp = Infinity;

  /** `paceMs`: the time that a picture has. */
  constructor(private readonly paceMs: number) {}

  get step(): Step {
    return STEPS[this.at] as Step;
  }

  /** Tell of a picture at `nowMs`; says whether the step has changed. */
  observe(nowMs: number): boolean {
    const tookMs = nowMs - (this.lastMs ?? nowMs);
    this.lastMs = nowMs;
    if (tookMs <= 0 || tookMs > AWAY_MS) return false;
    this.pictures += 1;
    if (tookMs > LATE * this.paceMs) this.late += 1;
    this.lateMs += tookMs;
    if (this.pictures < WINDOW) return false;
    const before = this.at;
    this.judge(this.late, this.lateMs / WINDOW);
    this.pictures = this.late = this.lateMs = 0;
    return this.at !== before;
  }

  private judge(late: number, meanMs: number): void {
    this.sinceUp += 1;
    if (late >= TOO_LATE) {
      if (this.sinceUp <= REGRET) this.patience = Math.min(MOST_PATIENCE, 2 * this.patience);
      this.calm = 0;
      this.at = Math.min(STEPS.length - 1, this.at + (meanMs > FAR_TOO_SLOW * this.paceMs ? 2 : 1));
      return;
    }
    this.calm = late <= CALM ? this.calm + 1 : 0;
    if (this.calm < this.patience || this.at === 0) return;
    this.calm = 0;
    this.sinceUp = 0;
    this.at -= 1;
  }
}

/**
 * Splats of each person, `most` together, by their size in view; whoever has fewer than their part
 * gives all, and leaves the others more.
 */
export function shareBudget(counts: readonly number[], sizes: readonly number[], most: number): number[] {
  const given = counts.map(() => 0);
  let open = counts.map((_, person) => person);
  let rest = most;
  while (open.length > 0) {
    const sum = open.reduce((all, person) => all + (sizes[person] ?? 0), 0);
    const part = (person: number): number => (rest * (sizes[person] ?? 0)) / Math.max(sum, 1e-9);
    const whole = open.filter((person) => (counts[person] ?? 0) <= part(person));
    if (whole.length === 0) {
      for (const person of open) given[person] = Math.floor(part(person));
      return given;
    }
    for (const person of whole) given[person] = counts[person] ?? 0;
    rest = most - given.reduce((all, one) => all + one, 0);
    open = open.filter((person) => !whole.includes(person));
  }
  return given;
}

/** Changes smaller than this share are not worth it: everybody would flicker as one turns. */
const STEADY = 0.15;

/** `next`, or the shares `before` where they still hold and are much the same. */
export function steadyShares(before: readonly number[], next: readonly number[], most: number): readonly number[] {
  const near = next.every((one, person) => Math.abs(one - (before[person] ?? 0)) <= STEADY * one);
  const within = before.reduce((all, one) => all + one, 0) <= most;
  return before.length === next.length && near && within ? before : next;
}

const MIN_DISTANCE_M = 0.5;
/** What lies beyond so wide an angle is not seen, but may be a moment later. */
const ASIDE_COS = Math.cos(1.1);
const ASIDE = 0.15;

/** How large somebody at `place` is in the picture, up to a factor. */
export function sizeInView({ worldToCamera: m, eye }: PassCamera, [x, y, z]: readonly [number, number, number]): number {
  const distance = Math.max(MIN_DISTANCE_M, Math.hypot(x - eye[0], y - eye[1], z - eye[2]));
  const depth = (m[8] ?? 0) * x + (m[9] ?? 0) * y + (m[10] ?? 0) * z + (m[11] ?? 0);
  return (depth < ASIDE_COS * distance ? ASIDE : 1) / distance ** 2;
}
