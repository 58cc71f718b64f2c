/** The head as the face's own points show it; the server's twin, which says why, is services/live/motion/head_following.py. */

import { HEAD, NECK, headInWorld } from "./body";
import { anglesOf, lengthOf, multiply, rotationBy, transposedProduct, turned, type Numbers } from "./rotations";

const SETTLING_S = 0.1;
const FARTHEST_RAD = Math.PI / 3;
const [HELD_S, EASED_S] = [1.5, 1];
const [REMEMBERED_S, SAME_S] = [1.5, 0.05];

/** How a head was turned in the picture of `timeS`, from rest to the world of the solver. */
export interface TurnedHead {
  rotation: Numbers;
  timeS: number;
}

export class HeadFollowing {
  private solved: TurnedHead[] = [];
  private seenOff: Numbers = new Float64Array(3);
  private off: Numbers = new Float64Array(3);
  private seenS = -Infinity;

  /** Note joints' rotations as solved of the picture of `timeS`, and a head that was seen. */
  update(head: TurnedHead | null, local: Numbers, timeS: number): void {
    const stepS = timeS - (this.solved.at(-1)?.timeS ?? -Infinity);
    this.solved = [...this.solved.filter((one) => one.timeS >= timeS - REMEMBERED_S), { rotation: headInWorld(local), timeS }];
    const first = this.seenS === -Infinity;
    if (head && head.timeS > this.seenS) this.observe(head);
    const share = first ? 1 : 1 - Math.exp(-stepS / SETTLING_S);
    this.off = this.off.map((value, c) => value + share * (this.seenOff[c]! - value));
  }

  /** Joints' rotations with the head where its face has it at `timeS`. */
  followed(local: Numbers, timeS: number): Numbers {
    const share = Math.min(Math.max(1 - (timeS - this.seenS - HELD_S) / EASED_S, 0), 1);
    if (share === 0) return local;
    const head = local.slice(9 * HEAD, 9 * HEAD + 9);
    // what the head is off by, in the neck's axes
    const turn = by(turned(head, 0, this.off), 0.5 * share);
    const out = local.slice();
    multiply(local, 9 * NECK, turn, 0, out, 9 * NECK);
    multiply(transposedProduct(turn, head), 0, by(this.off, share), 0, out, 9 * HEAD);
    return out;
  }

  private observe(head: TurnedHead): void {
    const away = (one: TurnedHead): number => Math.abs(one.timeS - head.timeS);
    const then = this.solved.reduce((one, other) => (away(other) < away(one) ? other : one));
    const off = anglesOf(transposedProduct(then.rotation, head.rotation));
    if (away(then) < SAME_S && lengthOf(off) < FARTHEST_RAD) [this.seenOff, this.seenS] = [off, head.timeS];
  }
}

function by(angles: Numbers, share: number): Numbers {
  return rotationBy(share * angles[0]!, share * angles[1]!, share * angles[2]!);
}
