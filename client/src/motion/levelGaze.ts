/** A head held level in the mean, whichever height the webcam has; the server's twin is services/live/eye_level.py. */

import { HEAD, NECK, headInWorld } from "./body";
import { multiply, type Numbers } from "./rotations";
import { Settling } from "./settling";

const FARTHEST_RAD = (25 * Math.PI) / 180;

export class LevelGaze {
  /** How far below the horizon the head looks in the mean, rad. */
  below = 0;
  private readonly settling = new Settling();

  /** Note where the head looks by joints' local rotations, `stepS` after the last time. */
  learn(local: Numbers, stepS: number): void {
    const below = -Math.asin(Math.min(Math.max(headInWorld(local)[5]!, -1), 1));
    this.below += this.settling.share(stepS) * (below - this.below);
  }

  /** The same rotations with the head raised as far as was learnt. */
  raised(local: Numbers): Numbers {
    const half = 0.5 * Math.min(Math.max(this.below, -FARTHEST_RAD), FARTHEST_RAD);
    const [cosine, sine] = [Math.cos(half), Math.sin(half)];
    const raising = Float64Array.of(1, 0, 0, 0, cosine, sine, 0, -sine, cosine);
    const out = local.slice();
    for (const joint of [NECK, HEAD]) multiply(local, 9 * joint, raising, 0, out, 9 * joint);
    return out;
  }
}
