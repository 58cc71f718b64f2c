/**
 * Which step of a guided recording is on, how far it is, and what became of the others. Pure: each function gives the
 * next state, and a state is plain data that outlives the page.
 */

import { sideShown } from "../landmarks/turn";
import { nothingSeen, shareAround, together, withTurn, type SidesSeen } from "./sidesSeen";
import { STEPS, judge, stepOf, turnInView, type Observation, type StepName } from "./steps";

export type Outcome = "passed" | "skipped";

export interface GuideState {
  /** Null: every step has its outcome. */
  current: StepName | null;
  outcomes: Partial<Record<StepName, Outcome>>;
  /** Of the present step: for how long it was done, ms. */
  heldMs: number;
  /** What to change, or that all is well, as people can read it: news that do not last are left out. */
  words: string;
  /** Whether these words say that the step is being done. */
  isGood: boolean;
  /** Whether something of the present step was seen that is worth recording. */
  isUnderWay: boolean;
  /** In the recording of each step that was passed, and of the present one so far. */
  seen: Partial<Record<StepName, SidesSeen>>;
  lastMs: number | null;
  /** Words that are not shown yet, and since when they hold. */
  coming: { words: string; sinceMs: number } | null;
}

/** Two pictures farther apart say nothing of the time between. */
const LONGEST_GAP_MS = 500;
const SETTLED_MS = 350;
const FACE_AGAIN = "Turn on until you face the camera again.";

export function beginGuide(): GuideState {
  return enter({ outcomes: {}, seen: {} }, firstOpen({}));
}

/** As it was stored, at the beginning of its step: what was being recorded went with the page. */
export function resumeGuide({ outcomes, seen, current }: GuideState): GuideState {
  return enter({ outcomes, seen }, current ?? firstOpen(outcomes));
}

/** How far the present step is, 0 to 1. */
export function progressOf(state: GuideState): number {
  if (state.current === null) return 1;
  const { holdMs } = stepOf(state.current);
  if (holdMs === null) return shareAround(state.seen[state.current] ?? nothingSeen());
  return Math.min(1, state.heldMs / holdMs);
}

/** Take a picture into account; the step that it completes is passed. */
export function observe(state: GuideState, observation: Observation): GuideState {
  const { current, lastMs } = state;
  if (current === null) return state;
  const { timeMs, seen } = observation;
  const passedMs = lastMs === null ? 0 : Math.min(LONGEST_GAP_MS, Math.max(0, timeMs - lastMs));
  const step = stepOf(current);
  const { rate, words, isUnderWay = rate > 0 } = judge(step, observation);
  const shown = seen && rate > 0 ? turnInView(seen) : null;
  const next: GuideState = {
    ...state,
    lastMs: timeMs,
    isUnderWay: state.isUnderWay || isUnderWay,
    // a moment that fails costs a moment, not the whole
    heldMs: Math.max(0, state.heldMs + (rate > 0 ? rate : -1) * passedMs),
  };
  if (shown) next.seen = { ...state.seen, [current]: withTurn(state.seen[current] ?? nothingSeen(), shown, passedMs) };
  const isFull = progressOf(next) >= 1;
  // the last side of a turn is whole once the first is there again
  const isAround = step.holdMs !== null || (shown?.body != null && sideShown(shown.body) === "front");
  if (isFull && isAround) return pass(next);
  return { ...next, ...settled(state, isFull && rate > 0 ? FACE_AGAIN : words, rate > 0, timeMs) };
}

/** The present step is done; the next is the first without an outcome. */
export function pass(state: GuideState): GuideState {
  return state.current === null ? state : leave(state, state.current, "passed", state.seen);
}

/** The present step is left out, with all that was seen in it. */
export function skip(state: GuideState): GuideState {
  return state.current === null ? state : leave(state, state.current, "skipped", without(state.seen, state.current));
}

/** What was recorded of the present step is given up; it goes on from its beginning. */
export function restart(state: GuideState): GuideState {
  return { ...enter(state, state.current), words: state.words };
}

/** Do a step anew, whatever became of it. */
export function goTo(state: GuideState, name: StepName): GuideState {
  const seen = state.current === null ? state.seen : without(state.seen, state.current);
  return enter({ outcomes: without(state.outcomes, name), seen: without(seen, name) }, name);
}

/** The step before the present one; from the end, the last. */
export function back(state: GuideState): GuideState {
  const at = STEPS.findIndex(({ name }) => name === state.current);
  const before = STEPS[(at < 0 ? STEPS.length : at) - 1];
  return before ? goTo(state, before.name) : state;
}

/** What was seen in all recordings that are kept, and in the present one. */
export function seenSoFar(state: GuideState): SidesSeen {
  return together(Object.values(state.seen));
}

export function passedSteps(state: GuideState): StepName[] {
  return STEPS.map(({ name }) => name).filter((name) => state.outcomes[name] === "passed");
}

function leave(state: GuideState, name: StepName, outcome: Outcome, seen: GuideState["seen"]): GuideState {
  const outcomes = { ...state.outcomes, [name]: outcome };
  return enter({ outcomes, seen }, firstOpen(outcomes));
}

function firstOpen(outcomes: GuideState["outcomes"]): StepName | null {
  return STEPS.find(({ name }) => outcomes[name] === undefined)?.name ?? null;
}

function enter({ outcomes, seen: kept }: Pick<GuideState, "outcomes" | "seen">, current: StepName | null): GuideState {
  const seen = current === null ? kept : without(kept, current);
  return { outcomes, seen, current, heldMs: 0, words: "", isGood: false, isUnderWay: false, lastMs: null, coming: null };
}

/** The words to show: new ones once they have held for a moment, so that nothing flickers. */
function settled(state: GuideState, words: string, isGood: boolean, timeMs: number): Pick<GuideState, "words" | "isGood" | "coming"> {
  if (words === state.words) return { words, isGood, coming: null };
  const sinceMs = state.coming?.words === words ? state.coming.sinceMs : timeMs;
  const isDue = state.words === "" || timeMs - sinceMs >= SETTLED_MS;
  return isDue ? { words, isGood, coming: null } : { words: state.words, isGood: state.isGood, coming: { words, sinceMs } };
}

function without<Of>(all: Partial<Record<StepName, Of>>, name: StepName): Partial<Record<StepName, Of>> {
  const { [name]: _, ...others } = all;
  return others as Partial<Record<StepName, Of>>;
}
