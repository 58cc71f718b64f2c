import { describe, expect, it } from "vitest";
import type { Point } from "../../src/landmarks/expression";
import { HEAD_POINTS } from "../../src/landmarks/head";
import { headRotation } from "../../src/motion/headRotation";
import { usualCamera } from "../../src/motion/liveSolver";
import { MotionSolver } from "../../src/motion/motionSolver";
import { rotationsBy, transposedProduct, anglesOf, lengthOf } from "../../src/motion/rotations";
import { readConstants } from "../../src/motion/constants";
import { CASES, CONSTANTS, FACE, bodyOf, expressionIn, headIn, seenIn } from "./solver";

/** Twice what floats of the lifter and the six digits that are told make of it. */
const TOLERANCE_RAD = 1e-5;
const TOLERANCE_M = 2e-6;
const TOLERANCE = 2e-6;
const A_BUSY_MACHINES_MS = 60_000;

/** The largest angle between rotations told as axis-angle and matrices, rad. */
function apart(told: readonly number[], rotations: Float64Array): number {
  const wanted = rotationsBy(Float64Array.from(told));
  let most = 0;
  for (let at = 0; at < wanted.length; at += 9) {
    const between = transposedProduct(wanted.slice(at, at + 9), rotations.slice(at, at + 9));
    most = Math.max(most, lengthOf(anglesOf(between)));
  }
  return most;
}

function off(told: readonly number[], numbers: ArrayLike<number>): number {
  expect(numbers).toHaveLength(told.length);
  return Math.max(...told.map((value, i) => Math.abs(value - numbers[i]!)));
}

describe("MotionSolver", () => {
  it.each(CASES.map((one, i) => [["an upper body, interrupted", "a whole body"][i], one] as const))(
    "moves as the server's solver does, frame by frame: %s",
    (_, one) => {
      const solver = new MotionSolver(bodyOf(one), CONSTANTS);
      for (const frame of one.frames) {
        const motion = solver.solve(seenIn(frame), expressionIn(frame), headIn(frame), frame.time_ms);
        const told = frame.motion;
        expect(motion === null).toBe(told === null);
        if (!motion || !told) continue;
        expect(motion.locked).toEqual(told.locked);
        expect(apart(told.local, motion.now.local)).toBeLessThan(TOLERANCE_RAD);
        expect(off(told.root, motion.now.root)).toBeLessThan(TOLERANCE_M);
        expect(off(told.expression, motion.expression)).toBeLessThan(TOLERANCE);
        const { more } = told;
        if (!more) continue;
        expect(off(more.ahead, motion.ahead)).toBeLessThan(TOLERANCE_RAD);
        expect(off(more.ahead_root, motion.aheadRoot)).toBeLessThan(TOLERANCE_M);
        expect(apart(more.seen, motion.seen.local)).toBeLessThan(TOLERANCE_RAD);
        expect(off(more.seen_root, motion.seen.root)).toBeLessThan(TOLERANCE_M);
      }
    },
    A_BUSY_MACHINES_MS,
  );

  it("has been tried on feet that step and feet that stand, on losses and on people who tell no pose", () => {
    const motions = CASES.flatMap(({ frames }) => frames.map(({ motion }) => motion));
    expect(motions.filter((one) => one === null)).toHaveLength(2);
    expect(new Set(motions.flatMap((one) => one?.locked ?? []))).toEqual(new Set([true, false]));
  });

  it("takes a later picture alone", () => {
    const [one] = CASES as [(typeof CASES)[number]];
    const solver = new MotionSolver(bodyOf(one), CONSTANTS);
    const [first, second] = one.frames;
    expect(solver.solve(seenIn(second!), null, null, second!.time_ms)).not.toBeNull();
    expect(solver.solve(seenIn(first!), null, null, first!.time_ms)).toBeNull();
  });
});

describe("headRotation", () => {
  it("is the server's, of a face off the picture's middle", () => {
    const { middle, points, width, height, rotation } = FACE;
    const seen = HEAD_POINTS.map((_, i) => points.slice(3 * i, 3 * i + 3) as unknown as Point);
    const { focal, centre } = usualCamera(width, height);
    const head = { middle: middle as [number, number], points: seen, timeMs: 0 };
    expect(off(rotation, headRotation(head, CONSTANTS.headPoints, focal, centre))).toBeLessThan(TOLERANCE);
  });
});

describe("readConstants", () => {
  it("refuses a file of another version", () => {
    expect(() => readConstants(new ArrayBuffer(8))).toThrow("must be 2844296 bytes long; got 8");
  });
});
