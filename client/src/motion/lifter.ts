/**
 * A pose from one picture's landmarks alone: closed-form kinematics, corrected by a small network. The server's twin,
 * which says how it was trained and what it takes, is capture/detection/lifter.py.
 */

import { JOINT_COUNT, LANDMARKS, PARENTS, type SolverConstants } from "./body";
import { relativeToParents, solvePose } from "./inverseKinematics";
import { cross, dot, lengthOf, multiply, type Numbers } from "./rotations";

const BLOCKS = 2;
const FEATURES = LANDMARKS * 12 + 1 + 6 * (JOINT_COUNT - 1) + 9;
const MIN_VISIBILITY = 0.02;
const MIN_SIZE = 1e-6;
const CLIP_DEVIATIONS = 6;
const NEAREST = 0.2;
const NORMALISATION_EPS = 1e-5;
/** Axes of the camera (x right, y down, z away) to y up and z towards it, and back. */
const FLIP = [1, -1, -1] as const;

/** Rotations relative to the parents [24 3 3]: of the pelvis in axes y up, z towards the camera. */
export function lift(
  pixels: Numbers,
  world: ArrayLike<number>,
  visibility: ArrayLike<number>,
  focal: number,
  centre: readonly [number, number],
  constants: SolverConstants,
): Numbers {
  const flipped = Float64Array.from(world, (value, i) => value * FLIP[(i % 3) as 0 | 1 | 2]);
  const local = solvePose(flipped, visibility, constants.typicalLandmarks);
  const closed = fromParents(local);
  const plane = Float64Array.from(pixels, (value, i) => (value - centre[(i % 2) as 0 | 1]) / focal);
  const view = viewThrough(plane, visibility);
  const body = closed.subarray(0, 9);
  const output = network(featuresOf(plane, view, world, flipped, visibility, local, body), constants);
  const turned = new Float64Array(9 * JOINT_COUNT);
  const [correction, out] = [new Float64Array(9), new Float64Array(9 * JOINT_COUNT)];
  // of the view to the camera's axes
  const back = Float64Array.from({ length: 9 }, (_, i) => {
    const [r, c] = [Math.floor(i / 3), i % 3];
    return view[3 * c + r]! * FLIP[r as 0 | 1 | 2] * FLIP[c as 0 | 1 | 2];
  });
  for (let k = 0; k < JOINT_COUNT; k++) {
    writeOrthonormal(output, 6 * k, correction);
    multiply(closed, 9 * k, correction, 0, turned, 9 * k);
    multiply(back, 0, turned, 9 * k, out, 9 * k);
  }
  return relativeToParents(out);
}

function fromParents(local: Numbers): Numbers {
  const world = local.slice();
  for (let k = 1; k < JOINT_COUNT; k++) multiply(world, 9 * PARENTS[k]!, local, 9 * k, world, 9 * k);
  return world;
}

function weightOf(visibility: ArrayLike<number>, m: number): number {
  return Math.min(Math.max(visibility[m]!, MIN_VISIBILITY), 1) ** 2;
}

/** Rows: axes of a view whose z goes through the person, x level. */
function viewThrough(plane: Numbers, visibility: ArrayLike<number>): Numbers {
  let [x, y, total] = [0, 0, 0];
  for (let m = 0; m < LANDMARKS; m++) {
    const weight = weightOf(visibility, m);
    x += weight * plane[2 * m]!;
    y += weight * plane[2 * m + 1]!;
    total += weight;
  }
  const through = unit([x / total, y / total, 1]);
  const across = unit(cross([0, 1, 0], through));
  return Float64Array.of(...across, ...cross(through, across), ...through);
}

function featuresOf(
  plane: Numbers,
  view: Numbers,
  world: ArrayLike<number>,
  flipped: Numbers,
  visibility: ArrayLike<number>,
  local: Numbers,
  body: Numbers,
): Float64Array {
  const flat = new Float64Array(2 * LANDMARKS);
  let [squares, total] = [0, 0];
  for (let m = 0; m < LANDMARKS; m++) {
    const ray = [plane[2 * m]!, plane[2 * m + 1]!, 1];
    const depth = Math.max(dot(view.subarray(6), ray), NEAREST);
    const weight = weightOf(visibility, m);
    for (let axis = 0; axis < 2; axis++) {
      const value = (flat[2 * m + axis] = dot(view.subarray(3 * axis), ray) / depth);
      squares += weight * value * value;
    }
    total += weight;
  }
  const size = Math.sqrt(squares / total) + MIN_SIZE;
  const normalised = flat.map((value) => Math.min(Math.max(value / size, -CLIP_DEVIATIONS), CLIP_DEVIATIONS));
  const features = new Float64Array(FEATURES);
  let at = 0;
  const put = (value: number): void => void (features[at++] = Math.fround(value));
  normalised.forEach(put);
  for (let i = 0; i < 3 * LANDMARKS; i++) put(2 * world[i]!);
  for (let m = 0; m < LANDMARKS; m++) put(visibility[m]!);
  put(Math.log(size));
  for (let m = 0; m < LANDMARKS; m++) {
    for (let c = 0; c < 3; c++) put(2 * inBody(body, c, flipped[3 * m]!, flipped[3 * m + 1]!, flipped[3 * m + 2]!));
  }
  for (let m = 0; m < LANDMARKS; m++) {
    for (let c = 0; c < 3; c++) put(inBody(body, c, normalised[2 * m]!, -normalised[2 * m + 1]!, 0));
  }
  for (let i = 9; i < 9 * JOINT_COUNT; i++) if (i % 3 < 2) put(local[i]!);
  body.forEach(put);
  return features;
}

/** A component of a vector in the body's own axes. */
function inBody(body: Numbers, c: number, x: number, y: number, z: number): number {
  return x * body[c]! + y * body[3 + c]! + z * body[6 + c]!;
}

/** Writes the rotation whose first two columns are nearest to what was told (Zhou et al. 2019); zeros give none. */
function writeOrthonormal(six: Float64Array, from: number, out: Numbers): void {
  const a = unit([six[from]! + 1, six[from + 1]!, six[from + 2]!]);
  const second = [six[from + 3]!, six[from + 4]! + 1, six[from + 5]!];
  const along = dot(a, second);
  const b = unit(second.map((value, c) => value - along * a[c]!));
  const c = cross(a, b);
  for (let r = 0; r < 3; r++) [out[3 * r], out[3 * r + 1], out[3 * r + 2]] = [a[r]!, b[r]!, c[r]!];
}

function unit(vector: ArrayLike<number>): Numbers {
  const length = lengthOf(vector);
  return Float64Array.from(vector, (value) => value / length);
}

function network(features: Float64Array, { lifter }: SolverConstants): Float64Array {
  const of = (name: string): Float32Array => {
    const weights = lifter.get(name);
    if (!weights) throw new Error(`the lifter must have ${name}; got ${[...lifter.keys()].join(", ")}`);
    return weights;
  };
  const linear = (name: string, x: Float64Array): Float64Array => {
    const [weight, bias] = [of(`${name}.weight`), of(`${name}.bias`)];
    const out = Float64Array.from(bias);
    const width = x.length;
    for (let row = 0; row < out.length; row++) {
      let sum = out[row]!;
      for (let i = 0, at = row * width; i < width; i++, at++) sum += weight[at]! * x[i]!;
      out[row] = sum;
    }
    return out;
  };
  const normalised = (name: string, x: Float64Array): Float64Array => {
    const [weight, bias] = [of(`${name}.weight`), of(`${name}.bias`)];
    const mean = x.reduce((sum, value) => sum + value, 0) / x.length;
    const variance = x.reduce((sum, value) => sum + (value - mean) ** 2, 0) / x.length;
    const scale = 1 / Math.sqrt(variance + NORMALISATION_EPS);
    return x.map((value, i) => (value - mean) * scale * weight[i]! + bias[i]!);
  };
  const [mean, deviation] = [of("mean"), of("deviation")];
  let hidden = linear("first", features.map((value, i) => (value - mean[i]!) / deviation[i]!)).map(silu);
  for (let block = 0; block < BLOCKS; block++) {
    let inner = hidden;
    for (let half = 0; half < 2; half++) {
      const name = `blocks.${block}.${half}`;
      inner = normalised(`${name}.norm`, linear(`${name}.linear`, inner)).map(silu);
    }
    hidden = hidden.map((value, i) => value + inner[i]!);
  }
  return linear("last", hidden);
}

function silu(x: number): number {
  return x / (1 + Math.exp(-Math.min(Math.max(x, -80), 80)));
}
