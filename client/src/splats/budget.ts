/**
 * How many splats a device draws, so that no picture comes late: steps by what pictures take, and
 * each step shared among people by their size in view. No DOM in here.
 */

import type { PassCamera } from "./camera";

/** What one step draws: splats of all together. */
export interface Step {
  splats: number;
}

/** What a budget goes by. */
export interface BudgetRules<S extends Step> {
  /** The most splats first. */
  steps: readonly S[];
  /** Place of the step to begin with. */
  first: number;
  /** The time that a picture has. */
  paceMs: number;
  /** A picture is late from so many times the pace on. */
  late: number;
  /** Pictures that are judged together. */
  window: number;
}

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

export class SplatBudget<S extends Step> {
  private at: number;
  private lastMs: number | null = null;
  private pictures = 0;
  private late = 0;
  private sumMs = 0;
  private calm = 0;
  private patience = PATIENCE;
  private sinceUp = Infinity;

  constructor(private readonly rules: BudgetRules<S>) {
    this.at = rules.first;
  }

  get step(): S {
    return this.rules.steps[this.at] as S;
  }

  /** No step draws fewer splats. */
  get atSmallest(): boolean {
    return this.at === this.rules.steps.length - 1;
  }

  /** Tell of a picture at `nowMs`, one after the other without a pause; says whether the step has changed. */
  observeAt(nowMs: number): boolean {
    const tookMs = nowMs - (this.lastMs ?? nowMs);
    this.lastMs = nowMs;
    return tookMs > 0 && tookMs <= AWAY_MS && this.observe(tookMs);
  }

  /** Tell of a picture that took `tookMs`; says whether the step has changed. */
  observe(tookMs: number): boolean {
    const { late, paceMs, window } = this.rules;
    this.pictures += 1;
    if (tookMs > late * paceMs) this.late += 1;
    this.sumMs += tookMs;
    if (this.pictures < window) return false;
    const before = this.at;
    this.judge(this.late, this.sumMs / window);
    this.pictures = this.late = this.sumMs = 0;
    return this.at !== before;
  }

  private judge(late: number, meanMs: number): void {
    this.sinceUp += 1;
    if (late >= TOO_LATE) {
      if (this.sinceUp <= REGRET) this.patience = Math.min(MOST_PATIENCE, 2 * this.patience);
      this.calm = 0;
      this.at = Math.min(this.rules.steps.length - 1, this.at + (meanMs > FAR_TOO_SLOW * this.rules.paceMs ? 2 : 1));
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

/** Splats a square of somebody's height in the picture: with more, nothing is gained (FULL_DENSITY of the server). */
const FULL_DENSITY = 0.25;
/** How high people are, about, m. */
const HEIGHT_M = 1.7;
/** Share of somebody's splats that come or go from one picture to the next: nobody sees it. */
const MOST_CHANGE = 0.05;
const LEAST_CHANGE = 50;

/** Who is drawn: see `LocalRoom`. */
export interface Sharers {
  readonly counts: readonly number[];
  readonly pelvisPositions: readonly (readonly [number, number, number])[];
}

/** The splats of each person from picture to picture. */
export class SplatShares {
  private goals: readonly number[] = [];
  private most = 0;
  private shares: readonly number[] = [];
  /** Splats of all together with which nothing would be lost in the last picture. */
  worth = 0;

  /** Nobody's number is on its way to another. */
  get settled(): boolean {
    return this.shares.every((share, person) => share === this.goals[person]);
  }

  /**
   * Splats of each person, `most` together, before this camera; no more than show at their size. A little
   * nearer to that with each picture; `atOnce`: as they are in the end.
   */
  of({ counts, pelvisPositions }: Sharers, camera: PassCamera, most: number, atOnce = false): readonly number[] {
    const sizes = pelvisPositions.map((place) => sizeInView(camera, place));
    const full = FULL_DENSITY * (camera.focalPx[1] * HEIGHT_M) ** 2;
    const worth = counts.map((count, person) => Math.min(count, Math.ceil(full * (sizes[person] ?? 0))));
    this.worth = worth.reduce((all, one) => all + one, 0);
    const next = shareBudget(worth, sizes, most);
    this.goals = most === this.most ? steadyShares(this.goals, next, most) : next;
    const before = this.shares;
    const known = this.most > 0 && before.length === counts.length && !atOnce;
    this.most = most;
    this.shares = known ? this.goals.map((goal, person) => stepTowards(before[person] ?? goal, goal)) : this.goals;
    return this.shares;
  }
}

function stepTowards(from: number, goal: number): number {
  const most = Math.max(LEAST_CHANGE, Math.floor(MOST_CHANGE * from));
  return from + Math.max(-most, Math.min(most, goal - from));
}
