import { describe, expect, it } from "vitest";
import { JOINT_COUNT } from "../../src/motion/body";
import { HeadFollowing } from "../../src/motion/headFollowing";
import { anglesOf, identities, product, rotationBy, type Numbers } from "../../src/motion/rotations";
import { HEAD, NECK } from "../../src/motion/body";

const STEP_S = 1 / 30;
const UPRIGHT = identities(JOINT_COUNT);

/** Somebody whose head is solved as looking ahead, picture by picture. */
function watched(following: HeadFollowing, fromS: number, toS: number): void {
  for (let timeS = fromS; timeS < toS - 1e-9; timeS += STEP_S) following.update(null, UPRIGHT, timeS);
}

/** About y, rad. */
function headTurn(local: Numbers): number {
  return anglesOf(product(local.slice(9 * NECK, 9 * NECK + 9), local.slice(9 * HEAD, 9 * HEAD + 9)))[1]!;
}

const turned = (rad: number, timeS: number) => ({ rotation: rotationBy(0, rad, 0), timeS });

describe("HeadFollowing", () => {
  it("takes a first head whole, neck and head half each, though it was seen some pictures ago", () => {
    const following = new HeadFollowing();
    watched(following, 0, 0.2);
    following.update(turned(0.4, 0.1), UPRIGHT, 0.2);
    const local = following.followed(UPRIGHT, 0.2);
    expect(headTurn(local)).toBeCloseTo(0.4, 9);
    expect(anglesOf(local, 9 * NECK)[1]).toBeCloseTo(0.2, 9);
  });

  it("comes to what differs without a jerk", () => {
    const following = new HeadFollowing();
    following.update(turned(0, 0), UPRIGHT, 0);
    following.update(turned(0.4, STEP_S), UPRIGHT, STEP_S);
    const first = headTurn(following.followed(UPRIGHT, STEP_S));
    expect(first).toBeGreaterThan(0.05);
    expect(first).toBeLessThan(0.2);
    watched(following, 2 * STEP_S, 0.7);
    expect(headTurn(following.followed(UPRIGHT, 0.7))).toBeCloseTo(0.4, 2);
  });

  it("holds it for a moment where no face is seen, then lets go", () => {
    const following = new HeadFollowing();
    following.update(turned(0.4, 0), UPRIGHT, 0);
    watched(following, STEP_S, 4);
    const at = (timeS: number): number => headTurn(following.followed(UPRIGHT, timeS));
    expect(at(1.4)).toBeCloseTo(0.4, 9);
    expect(at(2)).toBeCloseTo(0.2, 9);
    expect(following.followed(UPRIGHT, 3)).toBe(UPRIGHT);
  });

  it("follows no head that is nowhere near, nor one of which no picture is known any more", () => {
    const following = new HeadFollowing();
    watched(following, 0, 3);
    following.update(turned(2, 2.9), UPRIGHT, 3);
    following.update(turned(0.4, 0.5), UPRIGHT, 3.1);
    expect(following.followed(UPRIGHT, 3.1)).toBe(UPRIGHT);
  });
});
