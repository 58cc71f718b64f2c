/** Damped Gauss-Newton steps from a pose to a better one; the server's twin is capture/live/gauss_newton_kernels.py. */

import { HIPS, JOINT_COUNT, LANDMARKS, PARENTS, placeJoints, placeLandmarks, type SolvedBody, type SolverConstants } from "./body";
import { Equations, UNKNOWNS, evaluate, type Observation } from "./energy";
import { allAngles, multiply, multiplyTransposed, rotationsBy, writeRotation, type Numbers } from "./rotations";

const DAMPING = 1e-2;
const FLOOR = 1e-6;

/** A pose that was found. */
export interface Found {
  local: Numbers;
  pelvis: Numbers;
  energy: number;
}

let [best, tried] = [new Equations(), new Equations()];
const damped = new Float64Array(UNKNOWNS * UNKNOWNS);
const step = new Float64Array(UNKNOWNS);

/** The better pose after so many steps. `precision`: 1 / deviation^2 of each unknown about the start. */
export function refined(
  local: Numbers,
  pelvis: Numbers,
  body: SolvedBody,
  constants: SolverConstants,
  seen: Observation,
  steps: number,
  precision: Numbers,
): Found {
  const scale = landmarkScale(local, body, seen);
  const world = seen.world.map((value) => value * scale);
  best.local = local;
  best.pelvis = pelvis;
  evaluate(best, body, constants, seen, world);
  let offset = new Float64Array(UNKNOWNS);
  let cost = best.energy;
  let damping = DAMPING;
  for (let number = 0; number < steps; number++) {
    solveStep(precision, offset, damping);
    tried.local = stepped(best);
    tried.pelvis = Float64Array.from(best.pelvis, (value, c) => value + step[3 * JOINT_COUNT + c]!);
    evaluate(tried, body, constants, seen, world);
    const moved = offset.map((value, i) => value + step[i]!);
    let newCost = tried.energy;
    for (let i = 0; i < UNKNOWNS; i++) newCost += 0.5 * precision[i]! * moved[i]! * moved[i]!;
    if (newCost < cost) {
      [best, tried] = [tried, best];
      [offset, cost] = [moved, newCost];
      damping *= 0.1;
    } else damping *= 10;
  }
  // products of rotations drift off SO(3), frame after frame, unless they are normalised
  return { local: rotationsBy(allAngles(best.local)), pelvis: best.pelvis, energy: best.energy };
}

/** The landmarks of the body whose pelvis is at the origin [33 3]. */
export function bodyLandmarks(local: Numbers, body: SolvedBody): Numbers {
  const [rotations, places] = [new Float64Array(9 * JOINT_COUNT), new Float64Array(3 * JOINT_COUNT)];
  placeJoints(local, [0, 0, 0], body.rest, rotations, places);
  const points = new Float64Array(3 * LANDMARKS);
  placeLandmarks(body, rotations, places, points);
  return points;
}

/** Solve (N + damping diag N + floor) step = right by Cholesky, into `step`. */
function solveStep(precision: Numbers, offset: Numbers, damping: number): void {
  const { normal, right } = best;
  for (let i = 0; i < UNKNOWNS; i++) {
    const row = i * UNKNOWNS;
    for (let j = 0; j <= i; j++) {
      const column = j * UNKNOWNS;
      let total = normal[row + j]!;
      if (i === j) {
        total += 0.5 * precision[i]!;
        total += damping * total + FLOOR;
      }
      for (let k = 0; k < j; k++) total -= damped[row + k]! * damped[column + k]!;
      damped[row + j] = i === j ? Math.sqrt(Math.max(total, FLOOR)) : total / damped[column + j]!;
    }
  }
  for (let i = 0; i < UNKNOWNS; i++) {
    let total = right[i]! - 0.5 * precision[i]! * offset[i]!;
    for (let k = 0; k < i; k++) total -= damped[i * UNKNOWNS + k]! * step[k]!;
    step[i] = total / damped[i * UNKNOWNS + i]!;
  }
  for (let i = UNKNOWNS - 1; i >= 0; i--) {
    let total = step[i]!;
    for (let k = i + 1; k < UNKNOWNS; k++) total -= damped[k * UNKNOWNS + i]! * step[k]!;
    step[i] = total / damped[i * UNKNOWNS + i]!;
  }
}

const rotation = new Float64Array(9);
const turnedParent = new Float64Array(9);

/** Local rotations after those of `step` about world axes: W^T exp(d) W L. */
function stepped({ local, rotations }: Equations): Numbers {
  const out = new Float64Array(local.length);
  for (let k = 0; k < JOINT_COUNT; k++) {
    writeRotation(step[3 * k]!, step[3 * k + 1]!, step[3 * k + 2]!, rotation);
    if (k > 0) {
      multiply(rotation, 0, rotations, 9 * PARENTS[k]!, turnedParent);
      multiplyTransposed(rotations, 9 * PARENTS[k]!, turnedParent, 0, rotation);
    }
    multiply(rotation, 0, local, 9 * k, out, 9 * k);
  }
  return out;
}

/** Scale of the body over that of the 3D landmarks, by least squares in this pose. */
function landmarkScale(local: Numbers, body: SolvedBody, { weights, world }: Observation): number {
  const points = bodyLandmarks(local, body);
  const middle = [0, 1, 2].map((c) => 0.5 * (points[3 * HIPS[0] + c]! + points[3 * HIPS[1] + c]!));
  let [product, square] = [0, 0];
  for (let m = 0; m < LANDMARKS; m++) {
    for (let c = 0; c < 3; c++) {
      const seen = world[3 * m + c]!;
      product += weights[m]! * (points[3 * m + c]! - middle[c]!) * seen;
      square += weights[m]! * seen * seen;
    }
  }
  return product / square;
}
