/** The body that is solved for: its joints and landmarks, and what the solver knows of people in general. */

import type { Numbers } from "./rotations";
import { multiply, product } from "./rotations";

/** Joint by joint, each behind its parent: the tree of SMPL, as the server's scene/skeleton.py. */
export const PARENTS = [
  -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21,
] as const; // prettier-ignore
export const JOINT_COUNT = PARENTS.length;
export const [SPINE1, SPINE2, SPINE3, NECK, HEAD] = [3, 6, 9, 12, 15] as const;
export const LEFT = { hip: 1, knee: 4, ankle: 7, foot: 10, collar: 13, shoulder: 16, elbow: 18, wrist: 20, hand: 22 } as const;
export const RIGHT = { hip: 2, knee: 5, ankle: 8, foot: 11, collar: 14, shoulder: 17, elbow: 19, wrist: 21, hand: 23 } as const;
/** About which a forearm bends, at rest. */
export const ELBOW_HINGE = { left: [0, -0.866, 0.5], right: [0, 0.866, -0.5] } as const;

/** MediaPipe's numbers of landmarks. */
export const LANDMARKS = 33;
export const FACE_LANDMARKS = 11;
/** The joint with which each landmark moves. */
export const LANDMARK_JOINTS = [
  ...Array.from({ length: FACE_LANDMARKS }, () => HEAD),
  LEFT.collar, RIGHT.collar, LEFT.elbow, RIGHT.elbow, LEFT.wrist, RIGHT.wrist,
  LEFT.wrist, RIGHT.wrist, LEFT.wrist, RIGHT.wrist, LEFT.wrist, RIGHT.wrist,
  0, 0, LEFT.knee, RIGHT.knee, LEFT.ankle, RIGHT.ankle, LEFT.ankle, RIGHT.ankle, LEFT.foot, RIGHT.foot,
] as const; // prettier-ignore
export const SHOULDERS = [11, 12] as const;
export const HIPS = [23, 24] as const;
/** The first and the last landmark of hands. */
export const HANDS = [15, 22] as const;

/** Somebody's own body; the server tells it (services/live/motion/body_packet.py). */
export interface SolvedBody {
  /** x, y, z of each joint at rest, m. */
  rest: Numbers;
  /** The same of each landmark. */
  landmarks: Numbers;
  /** About +y, rad: from facing the camera to how they face in the room. */
  yaw: number;
}

/** What holds for everybody: capture/live/solver_constants.py. */
export interface SolverConstants {
  /** Usual angles of the joints, rad [24 3]. */
  mean: Numbers;
  /** Rows along which `stiffness` counts [24 3 3]. */
  axes: Numbers;
  /** 1 / deviation^2 [24 3]. */
  stiffness: Numbers;
  /** Landmarks of the mean body at rest, m [33 3]. */
  typicalLandmarks: Numbers;
  /** A face's `HEAD_POINTS` at rest, m from the head's joint [33 3]. */
  headPoints: Numbers;
  lifter: ReadonlyMap<string, Float32Array>;
}

/** Writes the joints' rotations in the world [24 3 3] and places [24 3], from those relative to their parents. */
export function placeJoints(
  local: Numbers,
  pelvis: ArrayLike<number>,
  rest: Numbers,
  rotations: Numbers,
  places: Numbers,
): void {
  for (let i = 0; i < 9; i++) rotations[i] = local[i]!;
  for (let c = 0; c < 3; c++) places[c] = pelvis[c]!;
  for (let k = 1; k < JOINT_COUNT; k++) {
    const above = PARENTS[k]!;
    multiply(rotations, 9 * above, local, 9 * k, rotations, 9 * k);
    for (let r = 0; r < 3; r++) {
      let place = places[3 * above + r]!;
      for (let c = 0; c < 3; c++) {
        place += rotations[9 * above + 3 * r + c]! * (rest[3 * k + c]! - rest[3 * above + c]!);
      }
      places[3 * k + r] = place;
    }
  }
}

/** The head's rotation in the world, by the joints' own. */
export function headInWorld(local: Numbers): Numbers {
  let head: Numbers = local.slice(0, 9);
  for (const joint of [SPINE1, SPINE2, SPINE3, NECK, HEAD]) head = product(head, local.subarray(9 * joint, 9 * joint + 9));
  return head;
}

/** Writes where the landmarks are [33 3]. */
export function placeLandmarks(body: SolvedBody, rotations: Numbers, places: Numbers, out: Numbers): void {
  for (let m = 0; m < LANDMARKS; m++) {
    const j = LANDMARK_JOINTS[m]!;
    for (let r = 0; r < 3; r++) {
      let place = places[3 * j + r]!;
      for (let c = 0; c < 3; c++) {
        place += rotations[9 * j + 3 * r + c]! * (body.landmarks[3 * m + c]! - body.rest[3 * j + c]!);
      }
      out[3 * m + r] = place;
    }
  }
}
