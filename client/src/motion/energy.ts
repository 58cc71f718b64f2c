/**
 * How badly a pose explains a picture's landmarks, and its normal equations; the server's twin, which says what
 * each number means, is capture/live/energy_kernels.py.
 *
 * Unknowns: a rotation of each joint (rad, world axes), then the pelvis' shift. The matrix is symmetric: only
 * what lies on and below its diagonal is written.
 */

import {
  FACE_LANDMARKS, HIPS, JOINT_COUNT, LANDMARKS, LANDMARK_JOINTS, PARENTS, placeJoints, placeLandmarks,
  type SolvedBody, type SolverConstants,
} from "./body"; // prettier-ignore
import { multiply, writeAxisAngle, type Numbers } from "./rotations";

export const UNKNOWNS = 3 * JOINT_COUNT + 3;
const PER_METRE = 1 / 0.07;
const FACE_DEPTH_WEIGHT = 0.3;
const NEAREST_M = 0.05;

/** One picture's landmarks, of a camera at the origin that looks along -z, y up. */
export interface Observation {
  /** px [33 2]. */
  pixels: Numbers;
  /** At most `weights` [33]. */
  pixelWeights: Numbers;
  /** 0 to 1 [33]. */
  weights: Numbers;
  /** From between the hips, axes y up, m [33 3]. */
  world: Numbers;
  /** 1 / deviation of a projected landmark, px. */
  perPixel: number;
  focal: number;
  /** px. */
  centre: readonly [number, number];
}

/** A pose with its energy and normal equations. */
export class Equations {
  /** Relative to the parent [24 3 3]. */
  local: Numbers = new Float64Array(9 * JOINT_COUNT);
  pelvis: Numbers = new Float64Array(3);
  readonly rotations = new Float64Array(9 * JOINT_COUNT);
  readonly normal = new Float64Array(UNKNOWNS * UNKNOWNS);
  readonly right = new Float64Array(UNKNOWNS);
  energy = 0;
}

const places = new Float64Array(3 * JOINT_COUNT);
const points = new Float64Array(3 * LANDMARKS);
const columns = new Int32Array(UNKNOWNS);
const rows = new Float64Array(3 * UNKNOWNS);
const imageRows = new Float64Array(3 * UNKNOWNS);
const residual = new Float64Array(3);

/** Work out `out`'s energy and equations for its pose. `world`: the landmarks in 3D, sized as the body. */
export function evaluate(
  out: Equations,
  body: SolvedBody,
  constants: SolverConstants,
  seen: Observation,
  world: Numbers,
): void {
  placeJoints(out.local, out.pelvis, body.rest, out.rotations, places);
  out.normal.fill(0);
  out.right.fill(0);
  out.energy = addLandmarks(out, body, seen, world) + addPrior(out, constants);
}

/**
 * Add `weight` times J^T J and J^T r of one residual of three numbers, which depends on `rotations` unknowns that
 * turn joints, each joint before its parent, and on the pelvis' shift or not.
 */
function add(out: Equations, jacobian: Numbers, rotations: number, shifts: boolean, weight: number): void {
  const { normal, right } = out;
  const count = shifts ? rotations + 3 : rotations;
  for (let a = 0; a < count; a++) {
    const i = columns[a]!;
    const x = weight * jacobian[a]!, y = weight * jacobian[UNKNOWNS + a]!, z = weight * jacobian[2 * UNKNOWNS + a]!; // prettier-ignore
    right[i]! -= x * residual[0]! + y * residual[1]! + z * residual[2]!;
    // those that lie on or below the diagonal
    const [first, end] = a < rotations ? [a - (a % 3), rotations] : [0, count];
    for (let b = first; b < end; b++) {
      const j = columns[b]!;
      if (j > i) continue;
      normal[i * UNKNOWNS + j]! += x * jacobian[b]! + y * jacobian[UNKNOWNS + b]! + z * jacobian[2 * UNKNOWNS + b]!;
    }
  }
}

/** The columns of all joints that move `joint`, and their number. */
function unknownsOf(joint: number): number {
  let count = 0;
  for (let k = joint; k >= 0; k = PARENTS[k]!) {
    for (let axis = 0; axis < 3; axis++) columns[count++] = 3 * k + axis;
  }
  return count;
}

/** d point / d x of the rotations in `columns` [3 count]. */
function writeRotationJacobian(count: number, point: number): void {
  for (let a = 0; a < count; a += 3) {
    const k = columns[a]!;
    writeLever(a, points[point]! - places[k]!, points[point + 1]! - places[k + 1]!, points[point + 2]! - places[k + 2]!);
  }
}

/** The columns of -[x, y, z]x, from column `a` on. */
function writeLever(a: number, x: number, y: number, z: number): void {
  const [second, third] = [UNKNOWNS + a, 2 * UNKNOWNS + a];
  rows[a] = rows[second + 1] = rows[third + 2] = 0;
  rows[a + 1] = z;
  rows[a + 2] = -y;
  rows[second] = -z;
  rows[second + 2] = x;
  rows[third] = y;
  rows[third + 1] = -x;
}

function addLandmarks(out: Equations, body: SolvedBody, seen: Observation, world: Numbers): number {
  placeLandmarks(body, out.rotations, places, points);
  const { focal, perPixel, centre, pixels, pixelWeights, weights } = seen;
  const middle = [0, 1, 2].map((c) => 0.5 * (points[3 * HIPS[0] + c]! + points[3 * HIPS[1] + c]!));
  let energy = 0;
  for (let m = 0; m < LANDMARKS; m++) {
    const weight = weights[m]!;
    if (weight <= 0) continue;
    const rotations = unknownsOf(LANDMARK_JOINTS[m]!);
    writeRotationJacobian(rotations, 3 * m);
    for (let axis = 0; axis < 3; axis++) {
      const a = rotations + axis;
      columns[a] = 3 * JOINT_COUNT + axis;
      for (let r = 0; r < 3; r++) rows[r * UNKNOWNS + a] = r === axis ? 1 : 0;
    }
    const count = rotations + 3;
    // the camera's axes: x right, y down, z away
    const depth = Math.max(-points[3 * m + 2]!, NEAREST_M);
    const u = points[3 * m]! / depth;
    const v = -points[3 * m + 1]! / depth;
    residual[2] = 0;
    residual[0] = (focal * u + centre[0] - pixels[2 * m]!) * perPixel;
    residual[1] = (focal * v + centre[1] - pixels[2 * m + 1]!) * perPixel;
    const scale = (focal * perPixel) / depth;
    for (let a = 0; a < count; a++) {
      const away = -rows[2 * UNKNOWNS + a]!;
      imageRows[a] = scale * (rows[a]! - u * away);
      imageRows[UNKNOWNS + a] = scale * (-rows[UNKNOWNS + a]! - v * away);
    }
    let robust = Math.sqrt(1 + residual[0]! ** 2 + residual[1]! ** 2);
    energy += 2 * pixelWeights[m]! * (robust - 1); // pseudo-Huber
    add(out, imageRows, rotations, true, pixelWeights[m]! / robust);

    // relative to the hips, which the root moves too: only the lever arm from them is left
    const root = rotations - 3;
    writeLever(root, points[3 * m]! - middle[0]!, points[3 * m + 1]! - middle[1]!, points[3 * m + 2]! - middle[2]!);
    let squared = 0;
    for (let r = 0; r < 3; r++) {
      residual[r] = (points[3 * m + r]! - middle[r]! - world[3 * m + r]!) * PER_METRE;
      squared += residual[r]! ** 2;
      for (let a = 0; a < rotations; a++) rows[r * UNKNOWNS + a]! *= PER_METRE;
    }
    robust = Math.sqrt(1 + squared);
    const inDepth = 0.5 * weight * (m < FACE_LANDMARKS ? FACE_DEPTH_WEIGHT : 1);
    energy += 2 * inDepth * (robust - 1);
    add(out, rows, rotations, false, inDepth / robust);
  }
  return energy;
}

const angles = new Float64Array(3);
const inverse = new Float64Array(9);
const jacobian = new Float64Array(9);

/** Half the squared distance of all joints but the root from the prior's mean, in deviations. */
function addPrior(out: Equations, { mean, axes, stiffness }: SolverConstants): number {
  let energy = 0;
  for (let k = 1; k < JOINT_COUNT; k++) {
    writeAxisAngle(out.local, 9 * k, angles);
    const x = angles[0]!, y = angles[1]!, z = angles[2]!; // prettier-ignore
    const square = x * x + y * y + z * z;
    const half = 0.5 * Math.sqrt(square);
    const coefficient = square < 1e-6 ? 1 / 12 : (1 - half / Math.tan(half)) / square;
    for (let r = 0; r < 3; r++) {
      for (let c = 0; c < 3; c++) inverse[3 * r + c] = coefficient * angles[r]! * angles[c]!;
      inverse[4 * r]! += 1 - coefficient * square;
    }
    inverse[1]! += 0.5 * z;
    inverse[3]! -= 0.5 * z;
    inverse[6]! += 0.5 * y;
    inverse[2]! -= 0.5 * y;
    inverse[5]! += 0.5 * x;
    inverse[7]! -= 0.5 * x;
    multiply(axes, 9 * k, inverse, 0, jacobian);
    const above = 9 * PARENTS[k]!;
    for (let s = 0; s < 3; s++) {
      columns[s] = 3 * k + s;
      const root = Math.sqrt(0.5 * stiffness[3 * k + s]!);
      residual[s] = 0;
      for (let c = 0; c < 3; c++) {
        residual[s]! += root * axes[9 * k + 3 * s + c]! * (angles[c]! - mean[3 * k + c]!);
        let sum = 0;
        for (let i = 0; i < 3; i++) sum += jacobian[3 * s + i]! * out.rotations[above + 3 * c + i]!;
        rows[s * UNKNOWNS + c] = root * sum;
      }
      energy += residual[s]! ** 2;
    }
    add(out, rows, 3, false, 1);
  }
  return energy;
}
