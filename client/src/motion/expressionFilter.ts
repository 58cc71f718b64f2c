/** What face and hands do, smoothed, and eased to rest where unseen; the server's twin is services/live/motion/expression_filter.py. */

import { EXPRESSION_COUNT, FACE, FACE_NUMBERS, FINGER_COUNT, LEFT_HAND, RIGHT_HAND, type ObservedExpression } from "../landmarks/expression";
import { lowPassShare } from "./poseFilter";

const HELD_S = 0.3;
const EASE_S = 0.5;
const CUTOFF_HZ = 3;
const PER_UNIT = 2;
const SPEED_CUTOFF_HZ = 4;
/** Of what is seen again after a gap. */
const FIRST_STEP_S = 1 / 30;

export class ExpressionFilter {
  private readonly values = new Float64Array(EXPRESSION_COUNT);
  private readonly seenS = new Float64Array(EXPRESSION_COUNT).fill(-Infinity);
  private readonly speed = new Float64Array(EXPRESSION_COUNT);
  /** As it came: speed has no lag. */
  private readonly before = new Float64Array(EXPRESSION_COUNT);

  /** Take what was seen at `timeS`, later than anything before. */
  update(seen: ObservedExpression | null, timeS: number): void {
    if (!seen?.known) return;
    for (let i = 0; i < EXPRESSION_COUNT; i++) {
      if (seen.known & groupOf(i)) this.follow(i, seen.values[i]!, timeS);
      else this.speed[i] = 0;
    }
  }

  /** Each number at `timeS`, 0 to 1. */
  at(timeS: number): Float64Array {
    return this.values.map((value, i) => {
      const gone = Math.min(Math.max((timeS - this.seenS[i]! - HELD_S) / EASE_S, 0), 1);
      return value * (1 - gone * gone * (3 - 2 * gone));
    });
  }

  private follow(i: number, now: number, timeS: number): void {
    const shown = this.at(timeS)[i]!;
    const since = timeS - this.seenS[i]!;
    const fresh = since <= HELD_S;
    // what comes back after a gap has no pace yet
    const stepS = fresh ? since : FIRST_STEP_S;
    const pace = (now - this.before[i]!) / stepS;
    this.speed[i] = fresh ? this.speed[i]! + lowPassShare(SPEED_CUTOFF_HZ * stepS) * (pace - this.speed[i]!) : 0;
    const cutoffHz = CUTOFF_HZ + PER_UNIT * Math.abs(this.speed[i]!);
    this.values[i] = shown + lowPassShare(cutoffHz * stepS) * (now - shown);
    [this.before[i], this.seenS[i]] = [now, timeS];
  }
}

function groupOf(i: number): number {
  if (i < FACE_NUMBERS) return FACE;
  return i < FACE_NUMBERS + FINGER_COUNT ? LEFT_HAND : RIGHT_HAND;
}
