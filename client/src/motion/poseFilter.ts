/** Smooths poses and predicts them briefly: the One-Euro filter; the server's twin is capture/live/filter.py. */

import { JOINT_COUNT } from "./body";
import { identities, integrated, lengthOf, multiply, relativeAngles, writeRotation, type Numbers } from "./rotations";

/** How far ahead a pose is predicted, s. */
export const AHEAD_S = 0.15;
const CUTOFF_HZ = 1.5;
const CUTOFF_PER_RAD_S = 1;
const CUTOFF_PER_M_S = 4;
const SPEED_CUTOFF_HZ = 1;

/** A body's pose: rotations relative to the parents [24 3 3], and what is added to the pelvis at rest, m. */
export interface LocalPose {
  local: Numbers;
  root: Numbers;
}

export class PoseFilter {
  private timeS: number | null = null;
  private rotations = identities(JOINT_COUNT);
  private root = new Float64Array(3);
  /** As it came: speed has no lag. */
  private measured: LocalPose = { local: this.rotations, root: this.root };
  private readonly angularVelocity = new Float64Array(3 * JOINT_COUNT);
  private readonly velocity = new Float64Array(3);

  add(local: Numbers, root: Numbers, timeS: number): void {
    const before = this.measured;
    this.measured = { local, root };
    if (this.timeS === null) {
      [this.rotations, this.root, this.timeS] = [local.slice(), root.slice(), timeS];
      return;
    }
    const stepS = timeS - this.timeS;
    this.timeS = timeS;
    this.filterRotations(before.local, local, stepS);
    const share = lowPassShare(SPEED_CUTOFF_HZ * stepS);
    for (let c = 0; c < 3; c++) {
      this.velocity[c]! += share * ((root[c]! - before.root[c]!) / stepS - this.velocity[c]!);
    }
    const own = lowPassShare((CUTOFF_HZ + CUTOFF_PER_M_S * lengthOf(this.velocity)) * stepS);
    this.root = this.root.map((value, c) => value + own * (root[c]! - value));
  }

  /** The pose `aheadS` after the last measurement. */
  pose(aheadS: number): LocalPose {
    const root = this.root.map((value, c) => value + aheadS * this.velocity[c]!);
    return { local: integrated(this.rotations, this.angularVelocity, aheadS), root };
  }

  private filterRotations(previous: Numbers, measured: Numbers, stepS: number): void {
    const moved = relativeAngles(previous, measured);
    const correction = relativeAngles(this.rotations, measured);
    const share = lowPassShare(SPEED_CUTOFF_HZ * stepS);
    const [step, filtered] = [new Float64Array(9), new Float64Array(9 * JOINT_COUNT)];
    for (let k = 0; k < 3 * JOINT_COUNT; k += 3) {
      let squared = 0;
      for (let c = k; c < k + 3; c++) {
        this.angularVelocity[c]! += share * (moved[c]! / stepS - this.angularVelocity[c]!);
        squared += this.angularVelocity[c]! ** 2;
      }
      const own = lowPassShare((CUTOFF_HZ + CUTOFF_PER_RAD_S * Math.sqrt(squared)) * stepS);
      writeRotation(own * correction[k]!, own * correction[k + 1]!, own * correction[k + 2]!, step);
      multiply(this.rotations, 3 * k, step, 0, filtered, 3 * k);
    }
    this.rotations = filtered;
  }
}

/** Share of the way that a low pass goes in a step of so many periods of its cutoff. */
export function lowPassShare(cycles: number): number {
  const ratio = 2 * Math.PI * cycles;
  return ratio / (1 + ratio);
}
