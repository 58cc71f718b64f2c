/** Somebody as the detector would find them, posed as the steps ask. */

import { LANDMARK_COUNT, type Landmarks } from "../../src/landmarks/landmarks";
import type { Observation } from "../../src/enrolment/steps";

export interface Pose {
  /** Degrees from the camera to the person's own left. */
  head?: number;
  body?: number;
  /** From ear to ear, seen from the front, in shares of the picture's height. */
  headSize?: number;
  /** Upper arms, degrees outwards from straight down. */
  arms?: number;
  hands?: "up" | "down" | "left only";
  legs?: boolean;
  /** Where the nose is, shares of the picture. */
  nose?: readonly [number, number];
}

const [WIDTH, HEIGHT] = [640, 480];
const radians = (degrees: number): number => (degrees * Math.PI) / 180;

/** Lengths are in heads, ear to ear: a head is 0.16 m. */
export function somebody(pose: Pose = {}): Landmarks {
  const { head = 0, body = head, headSize = 0.1, arms = 40, hands = "down", legs = true, nose = [0.5, 0.2] } = pose;
  const world = new Float32Array(3 * LANDMARK_COUNT);
  const visibility = new Float32Array(LANDMARK_COUNT).fill(1);
  const places: [number, number][] = Array.from({ length: LANDMARK_COUNT }, () => [0, 0]);
  /** `across` to their left and `front`, turned; `down` from the nose. */
  const put = (i: number, turn: number, across: number, down: number, front = 0): void => {
    const x = across * Math.cos(radians(turn)) + front * Math.sin(radians(turn));
    const z = across * Math.sin(radians(turn)) - front * Math.cos(radians(turn));
    world.set([0.16 * x, 0.16 * down, 0.16 * z], 3 * i);
    places[i] = [x, down];
  };
  put(0, head, 0, 0, 0.6);
  for (let i = 1; i <= 3; i++) put(i, head, 0.1 * i, -0.2, 0.45);
  for (let i = 4; i <= 6; i++) put(i, head, -0.1 * (i - 3), -0.2, 0.45);
  put(7, head, 0.5, 0);
  put(8, head, -0.5, 0);
  put(9, head, 0.2, 0.35, 0.45);
  put(10, head, -0.2, 0.35, 0.45);
  for (const [side, sign] of [[0, 1], [1, -1]] as const) {
    const out = Math.sin(radians(arms));
    const isUp = hands === "up" || (hands === "left only" && side === 0);
    put(11 + side, body, sign * 1.2, 1.6);
    put(13 + side, body, sign * (1.2 + 1.8 * out), 1.6 + 1.8 * Math.cos(radians(arms)));
    const wrist = isUp ? 1 : 5;
    put(15 + side, body, sign * (1.4 + 2 * out), wrist);
    for (const finger of [17, 19, 21]) put(finger + side, body, sign * (1.4 + 2 * out), wrist + (isUp ? -0.5 : 0.5));
    put(23 + side, body, sign * 0.7, 4.8);
    for (const [joint, down] of [[25, 7.3], [27, 9.6], [29, 9.8], [31, 9.9]] as const) {
      put(joint + side, body, sign * 0.7, down);
      visibility[joint + side] = legs ? 1 : 0;
    }
  }
  const xy = Float32Array.from(places.flatMap(([x, y]) => [nose[0] + (x * headSize * HEIGHT) / WIDTH, nose[1] + y * headSize]));
  return { width: WIDTH, height: HEIGHT, xy, world, visibility };
}

export function observation(timeMs: number, seen: Landmarks | null, quality: Partial<Observation["quality"]> = {}): Observation {
  return { timeMs, seen, quality: { brightness: 0.8, sharpness: 0.5, ...quality } };
}

/** What each step asks for. */
export const DONE = {
  face: somebody({ headSize: 0.3, nose: [0.5, 0.5] }),
  turn_left: somebody({ head: 70, body: 20, headSize: 0.3, nose: [0.5, 0.5] }),
  turn_right: somebody({ head: -70, body: -20, headSize: 0.3, nose: [0.5, 0.5] }),
  step_back: somebody({ headSize: 0.07 }),
  arms: somebody({ headSize: 0.07, arms: 35 }),
  hands: somebody({ headSize: 0.12, hands: "up", legs: false }),
} as const;
