/**
 * Keeps a live performer on their feet: upright, on the floor, and no foot slides; the server's twin, which says why,
 * is services/live/motion/foot_locking.py. Axis y is up; lengths are in metres.
 */

import { JOINT_COUNT, NECK, placeJoints } from "./body";
import { LEGS, level, reachWith, type FootPlace } from "./legs";
import type { LocalPose } from "./poseFilter";
import {
  lengthOf, multiply, product, rotationBetween, rotationBy, slerp, transposedProduct, turned, type Numbers,
} from "./rotations"; // prettier-ignore
import { Settling } from "./settling";

const UP = [0, 1, 0] as const;
const HOME_S = 10;
const FARTHEST_M = 0.75;
const LEGS_S = 0.5;
const [STEP_M, STEP_RAD, RAISED_M] = [0.08, 0.5, 0.05];
const [LANDED_M, FLOOR_M] = [0.04, 0.03];
const STEP_S = 0.1;
const LIFT = 0.35;
const FLAT = 1 - 1e-7;

/** An ankle locked to the floor, or stepping. */
class FootTarget implements FootPlace {
  constructor(
    readonly position: Numbers,
    readonly rotation: Numbers,
    readonly locked = true,
    /** From where the leg alone would have it, m; decays while it steps. */
    private readonly offset: Numbers = new Float64Array(3),
  ) {}

  /** The foot a moment later, when the leg alone would have it at `wanted`. */
  stepped(wanted: FootPlace, floor: number, stepS: number): FootTarget {
    const { position, rotation } = this;
    const keep = Math.exp(-stepS / STEP_S);
    const [x, z] = [0, 2].map((c) => position[c]! - wanted.position[c]!) as [number, number];
    if (this.locked && !this.mustStep(wanted)) {
      const lower = Float64Array.of(position[0]!, position[1]! + (1 - keep) * (floor - position[1]!), position[2]!);
      return new FootTarget(lower, flatter(rotation, 1 - keep));
    }
    const following = slerp(rotation, wanted.rotation, 1 - keep);
    if (!this.locked && Math.hypot(x, z) < LANDED_M && wanted.position[1]! - floor < FLOOR_M) {
      return new FootTarget(position, following);
    }
    const offset = Float64Array.of(keep * x, LIFT * Math.hypot(keep * x, keep * z), keep * z);
    const shown = offset.map((value, c) => value + wanted.position[c]!);
    return new FootTarget(shown, following, false, offset);
  }

  /** In a pose that is not the last one, a little ahead. */
  target(wanted: FootPlace): FootPlace {
    if (!this.locked) {
      return { position: wanted.position.map((value, c) => value + this.offset[c]!), rotation: wanted.rotation };
    }
    return this.mustStep(wanted) ? wanted : this;
  }

  private mustStep({ position, rotation }: FootPlace): boolean {
    const away = position.map((value, c) => value - this.position[c]!);
    const trace = rotation.reduce((sum, value, i) => sum + value * this.rotation[i]!, 0); // of R^T S
    return Math.hypot(away[0]!, away[2]!) > STEP_M || away[1]! > RAISED_M || trace < 1 + 2 * Math.cos(STEP_RAD);
  }
}

interface PlacedPose {
  local: Numbers;
  pelvis: Numbers;
}

/** One performer's feet. Poses come in before the camera, and go out upright, at x = z = 0 or about. */
export class FootLocking {
  private up: Numbers = Float64Array.from(UP);
  private readonly settling = new Settling();
  private home: Numbers | null = null;
  /** How far legs count as seen, 0 to 1. */
  private legs = 0;
  private feet: FootTarget[] = [];
  private readonly yaw: Numbers;
  private uprightRotation: Numbers;
  private readonly rotations = new Float64Array(9 * JOINT_COUNT);
  private readonly places = new Float64Array(3 * JOINT_COUNT);

  constructor(
    private readonly rest: Numbers,
    yaw: number,
  ) {
    this.yaw = this.uprightRotation = rotationBy(0, yaw, 0);
  }

  /** Which feet stand still: left, right. */
  get locked(): boolean[] {
    return this.feet.map(({ locked }) => locked);
  }

  /** The newest pose on its feet, `stepS` after the one before. */
  update(pose: LocalPose, legsSeen: boolean, stepS: number): LocalPose {
    const goal = legsSeen ? 1 : 0;
    if (!this.home) this.legs = goal;
    const largest = stepS / LEGS_S;
    this.legs += Math.min(Math.max(goal - this.legs, -largest), largest);
    const seen = { local: pose.local, pelvis: this.pelvisOf(pose) };
    this.learnUp(seen, legsSeen, stepS);
    const upright = this.upright(seen);
    this.home ??= upright.pelvis;
    const share = Math.min(1, stepS / HOME_S);
    this.home = this.home.map((value, c) => value + share * (upright.pelvis[c]! - value));
    const grounded = this.grounded(upright, this.home);
    const wanted = this.wanted(grounded);
    if (!this.feet.length) this.feet = wanted.map(({ position, rotation }) => new FootTarget(position, rotation));
    this.feet = this.feet.map((foot, side) => foot.stepped(wanted[side]!, this.rest[3 * LEGS[side]!.ankle + 1]!, stepS));
    return this.solveLegs(grounded, this.feet);
  }

  /** A pose predicted from the newest one, on the same feet. */
  ahead(pose: LocalPose): LocalPose {
    const upright = this.upright({ local: pose.local, pelvis: this.pelvisOf(pose) });
    const grounded = this.grounded(upright, this.home ?? upright.pelvis);
    const wanted = this.wanted(grounded);
    return this.solveLegs(grounded, this.feet.map((foot, side) => foot.target(wanted[side]!)));
  }

  private pelvisOf({ root }: LocalPose): Numbers {
    return root.map((value, c) => value + this.rest[c]!);
  }

  private learnUp({ local, pelvis }: PlacedPose, legsSeen: boolean, stepS: number): void {
    this.place(local, pelvis);
    const { places } = this;
    // in the mean whoever stands is upright from ankles to neck; whoever shows no legs may sit, with an upright trunk
    const below = [0, 1, 2].map((c) =>
      legsSeen ? 0.5 * (places[3 * LEGS[0].ankle + c]! + places[3 * LEGS[1].ankle + c]!) : places[c]!,
    );
    const up = Float64Array.from(below, (value, c) => places[3 * NECK + c]! - value);
    const [length, share] = [lengthOf(up), this.settling.share(stepS)];
    this.up = this.up.map((value, c) => value + share * (up[c]! / length - value));
    this.uprightRotation = product(this.yaw, rotationBetween(this.up, UP));
  }

  /** The same with the vertical where it is. */
  private upright({ local, pelvis }: PlacedPose): PlacedPose {
    const out = local.slice();
    multiply(this.uprightRotation, 0, local, 0, out, 0);
    return { local: out, pelvis: turned(this.uprightRotation, 0, pelvis) };
  }

  /** Legs as far as they are seen, straight ones for the rest; a foot on the floor. */
  private grounded({ local, pelvis }: PlacedPose, home: Numbers): PlacedPose {
    const out = local.slice();
    if (this.legs < 1) this.straighten(out);
    const [x, z] = [0, 2].map((c) => this.legs * (pelvis[c]! - home[c]!)) as [number, number];
    const scale = Math.min(1, FARTHEST_M / Math.max(Math.hypot(x, z), 1e-9));
    const away = Float64Array.of(scale * x, 0, scale * z);
    this.place(out, away);
    away[1] = Math.max(
      ...LEGS.flatMap(({ ankle, foot }) => [ankle, foot]).map((joint) => this.rest[3 * joint + 1]! - this.places[3 * joint + 1]!),
    );
    return { local: out, pelvis: away };
  }

  /** Straighten the legs as far as they are not seen. */
  private straighten(local: Numbers): void {
    const root = local.slice(0, 9);
    const upright = transposedProduct(root, level(root));
    for (const { hip, knee, ankle, foot } of LEGS) {
      for (const joint of [hip, knee, ankle, foot]) {
        const straight = joint === hip ? upright : rotationBy(0, 0, 0);
        const seen = local.slice(9 * joint, 9 * joint + 9);
        local.set(this.legs ? slerp(straight, seen, this.legs) : straight, 9 * joint);
      }
    }
  }

  /** Where the legs alone would have the feet. */
  private wanted({ local, pelvis }: PlacedPose): FootPlace[] {
    this.place(local, pelvis);
    return LEGS.map(({ ankle }) => ({
      position: this.places.slice(3 * ankle, 3 * ankle + 3),
      rotation: this.rotations.slice(9 * ankle, 9 * ankle + 9),
    }));
  }

  private solveLegs({ local, pelvis }: PlacedPose, feet: readonly FootPlace[]): LocalPose {
    const out = local.slice();
    const sink = reachWith(out, pelvis, this.rest, feet);
    return { local: out, root: pelvis.map((value, c) => value + (c === 1 ? sink : 0) - this.rest[c]!) };
  }

  private place(local: Numbers, pelvis: Numbers): void {
    placeJoints(local, pelvis, this.rest, this.rotations, this.places);
  }
}

/** A foot `share` of the way to lying flat on the floor. */
function flatter(rotation: Numbers, share: number): Numbers {
  return rotation[4]! > FLAT ? rotation : slerp(rotation, level(rotation), share);
}
