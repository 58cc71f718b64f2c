/**
 * From a person's landmarks, picture by picture, to how their performer moves: the live solver, on their feet, with a
 * level gaze. The server's twin is services/live/motion/motion_solver.py; tests hold both to the same motion
 * (tests/services/live/motion.json).
 */

import type { ObservedExpression } from "../landmarks/expression";
import type { ObservedHead } from "../landmarks/head";
import type { Landmarks } from "../landmarks/landmarks";
import type { SolvedBody, SolverConstants } from "./body";
import { ExpressionFilter } from "./expressionFilter";
import { FootLocking } from "./footLocking";
import { HeadFollowing, type TurnedHead } from "./headFollowing";
import { headRotation } from "./headRotation";
import { LevelGaze } from "./levelGaze";
import { LiveSolver, usualCamera } from "./liveSolver";
import type { LocalPose } from "./poseFilter";
import { relativeAngles, type Numbers } from "./rotations";

const FIRST_STEP_S = 1 / 30;
const LEGS_SEEN = 0.3;
/** Knees and ankles. */
const LEGS = [25, 26, 27, 28] as const;
/** A smaller person tells no pose. */
const SMALLEST_PX = 40;

/** What one picture came to. */
export interface SolvedMotion {
  timeMs: number;
  /** On their feet, in the room's axes, about where they stand. */
  now: LocalPose;
  /** What the joints turn by, rad [24 3], and the root moves by, m, in the 0.15 s from then. */
  ahead: Numbers;
  aheadRoot: Numbers;
  /** Which feet stand still: left, right. */
  locked: boolean[];
  /** Of the server's `EXPRESSION_NAMES`, 0 to 1. */
  expression: Float64Array;
  /** Before the camera: neither on the floor nor with a level gaze. */
  seen: LocalPose;
  /** px, of the picture. */
  width: number;
  height: number;
}

export class MotionSolver {
  private solver: { width: number; height: number; of: LiveSolver } | null = null;
  private footLocking: FootLocking;
  private readonly head = new HeadFollowing();
  private readonly gaze = new LevelGaze();
  private readonly expression = new ExpressionFilter();
  private timeS: number | null = null;
  private headMs = -Infinity;

  constructor(
    private readonly body: SolvedBody,
    private readonly constants: SolverConstants,
  ) {
    this.footLocking = new FootLocking(body.rest, body.yaw);
  }

  /**
   * How they move by what was seen at `timeMs`, and of the head at last; null where that tells no pose: the motion goes
   * on without.
   */
  solve(
    seen: Landmarks,
    expression: ObservedExpression | null,
    head: ObservedHead | null,
    timeMs: number,
  ): SolvedMotion | null {
    const timeS = timeMs / 1000;
    if (tall(seen) < SMALLEST_PX || !(this.timeS === null || timeS > this.timeS)) return null;
    const solved = this.solverFor(seen).step(seen, timeS);
    if (!solved) {
      this.solver = null; // what it believes may be spoilt
      return null;
    }
    this.head.update(this.newlyTurned(head, seen), solved.now.local, timeS);
    for (const pose of [solved.now, solved.ahead]) pose.local = this.head.followed(pose.local, timeS);
    const stepS = this.timeS === null ? FIRST_STEP_S : timeS - this.timeS;
    this.timeS = timeS;
    this.expression.update(expression, timeS);
    const legs = median(LEGS.map((m) => solved.weights[m]!));
    const locked = this.footLocking.update(solved.now, legs > LEGS_SEEN, stepS);
    this.gaze.learn(locked.local, stepS);
    const now = { ...locked, local: this.gaze.raised(locked.local) };
    const ahead = this.footLocking.ahead(solved.ahead);
    return {
      timeMs,
      now,
      ahead: relativeAngles(now.local, this.gaze.raised(ahead.local)),
      aheadRoot: ahead.root.map((value, c) => value - now.root[c]!),
      locked: this.footLocking.locked,
      expression: this.expression.at(timeS),
      seen: solved.now,
      width: seen.width,
      height: seen.height,
    };
  }

  /** How a head is turned that was not seen before. */
  private newlyTurned(head: ObservedHead | null, { width, height }: Landmarks): TurnedHead | null {
    if (!head || head.timeMs <= this.headMs) return null;
    this.headMs = head.timeMs;
    const { focal, centre } = usualCamera(width, height);
    return { rotation: headRotation(head, this.constants.headPoints, focal, centre), timeS: head.timeMs / 1000 };
  }

  /** The solver for pictures of this size; a turned phone needs another. */
  private solverFor({ width, height }: Landmarks): LiveSolver {
    if (this.solver?.width !== width || this.solver.height !== height) {
      this.solver = { width, height, of: new LiveSolver(this.body, this.constants) };
    }
    return this.solver.of;
  }
}

/** Of whoever is seen: the larger extent, px. */
function tall({ xy, width, height }: Landmarks): number {
  const extent = (axis: number, size: number): number => {
    const values = xy.filter((_, i) => i % 2 === axis);
    return size * (Math.max(...values) - Math.min(...values));
  };
  return Math.max(extent(0, width), extent(1, height));
}

function median(values: readonly number[]): number {
  const sorted = [...values].sort((a, b) => a - b);
  return (sorted[1]! + sorted[2]!) / 2;
}
