/**
 * How somebody moves whose motion comes sealed, read at any moment: predicted over a short gap, eased to rest over a
 * longer one, eased back. The server's twin, which says why, is services/live/motion/live_motion.py; here legs
 * at rest are straight, and feet may slide on the way there, since a page that only draws solves no feet.
 */

import { ELBOW_HINGE, JOINT_COUNT, LEFT, RIGHT } from "./body";
import type { ReadMotion } from "./motionReader";
import { AHEAD_S, type LocalPose } from "./poseFilter";
import { identities, integrated, relativeAngles, writeRotation, type Numbers } from "./rotations";

const EASE_S = 1;
const BACK_S = 0.3;
const CLOCK_DRIFT = 1e-3;
const HELD_S = 0.3;
const EXPRESSION_EASE_S = 0.5;
const [HANGING_RAD, ELBOW_RAD] = [1.45, 0.3];

interface State {
  motion: ReadMotion;
  timeS: number;
  /** Our clock less the camera's. */
  offsetS: number;
  /** Since when they are seen without a longer gap, and how far from rest they were shown then. */
  backS: number;
  backShare: number;
}

export interface ShownPose extends LocalPose {
  expression: Numbers;
}

export class FollowedMotion {
  private state: State | null = null;
  private readonly hanging: Numbers;

  /** Whoever faces their camera is turned by `yawRad` about +y. */
  constructor(yawRad: number) {
    this.hanging = identities(JOINT_COUNT);
    writeRotation(0, yawRad, 0, this.hanging, 0);
    for (const [side, out, hinge] of [[LEFT, 1, ELBOW_HINGE.left], [RIGHT, -1, ELBOW_HINGE.right]] as const) {
      writeRotation(0, 0, -out * HANGING_RAD, this.hanging, 9 * side.shoulder);
      writeRotation(ELBOW_RAD * hinge[0], ELBOW_RAD * hinge[1], ELBOW_RAD * hinge[2], this.hanging, 9 * side.elbow);
    }
  }

  /** Move as `motion` says, which is later than the last one and came at `arrivedS` of our clock. */
  follow(motion: ReadMotion, arrivedS: number): void {
    const { state: last } = this;
    const timeS = motion.timeMs / 1000;
    const next: State = { motion, timeS, offsetS: arrivedS - timeS, backS: timeS, backShare: 1 };
    if (last) {
      const stepS = timeS - last.timeS;
      next.offsetS = Math.min(next.offsetS, last.offsetS + CLOCK_DRIFT * stepS);
      const gap = stepS > AHEAD_S;
      [next.backS, next.backShare] = gap ? [timeS, share(last, timeS)] : [last.backS, last.backShare];
    }
    this.state = next;
  }

  /** How old the newest picture was as its motion left, at least 1; 0 until some came. */
  get ageMs(): number {
    return this.state ? Math.max(1, this.state.motion.ageMs) : 0;
  }

  /** The pose at `nowS` of our clock; at rest until some motion came. */
  poseAt(nowS: number): ShownPose {
    const { state, hanging } = this;
    if (!state) return { local: hanging, root: new Float64Array(3), expression: new Float64Array(0) };
    const { now, ahead, aheadRoot, expression } = state.motion;
    const timeS = nowS - state.offsetS;
    const factor = clamped((timeS - state.timeS) / AHEAD_S);
    let local = integrated(now.local, ahead, factor);
    let root = now.root.map((place, c) => place + factor * aheadRoot[c]!);
    const seen = share(state, timeS);
    if (seen < 1) {
      local = integrated(hanging, relativeAngles(hanging, local), seen);
      const rest = [now.root[0]!, 0, now.root[2]!];
      root = root.map((place, c) => rest[c]! + seen * (place - rest[c]!));
    }
    const kept = seen * (1 - smooth((timeS - state.timeS - HELD_S) / EXPRESSION_EASE_S));
    return { local, root, expression: expression.map((value) => kept * value) };
  }
}

/** How much of what was seen is shown at `timeS`, and not rest: 0 to 1. */
function share({ timeS: newestS, backS, backShare }: State, timeS: number): number {
  const seenS = Math.min(timeS, newestS + AHEAD_S);
  const back = Math.min(1, backShare + Math.max(0, seenS - backS) / BACK_S);
  return back * (1 - smooth((timeS - seenS) / EASE_S));
}

function smooth(value: number): number {
  const gone = clamped(value);
  return gone * gone * (3 - 2 * gone);
}

function clamped(value: number): number {
  return Math.min(Math.max(value, 0), 1);
}
