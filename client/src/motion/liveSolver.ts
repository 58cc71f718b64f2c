/**
 * Poses from one picture's landmarks at a time, for a known body; the server's twin, which says why what is done, is
 * capture/live/solver.py.
 */

import type { Landmarks } from "../landmarks/landmarks";
import { FACE_LANDMARKS, HANDS, HIPS, JOINT_COUNT, LANDMARKS, SHOULDERS, type SolvedBody, type SolverConstants } from "./body";
import { UNKNOWNS, type Observation } from "./energy";
import { bodyLandmarks, refined, type Found } from "./gaussNewton";
import { lift } from "./lifter";
import { AHEAD_S, PoseFilter, type LocalPose } from "./poseFilter";
import type { Numbers } from "./rotations";

const STEPS = 2;
const INITIAL_STEPS = 6;
const LIFT_EVERY = 60;
const GAP_S = 0.3;
const [TURNING_RAD_S, MOVING_M_S] = [3, 1];
const POOR_FIT = 2;
const PIXEL_DEVIATION = 0.016;
const TYPICAL_SHARE = 0.1;
/** Of usual cameras, in longer sides of the picture. */
const FOCAL = 0.87;
const LEAST_WEIGHT = 0.1;
const FACE_WEIGHT = 0.35;
const EDGE = 0.1;
const [HEIGHTS_A_TRUNK, SMALLEST_HEIGHT_PX] = [3.4, 20];
const NO_PRECISION = new Float64Array(UNKNOWNS);

/** What one picture came to. */
export interface Solved {
  now: LocalPose;
  /** `AHEAD_S` later, at this pace. */
  ahead: LocalPose;
  /** Of each landmark, 0 to 1. */
  weights: Numbers;
}

export class LiveSolver {
  private readonly filter = new PoseFilter();
  private last: Found | null = null;
  private timeS = -Infinity;
  private typicalEnergy = 0;
  private framesSinceLift = 0;

  constructor(
    private readonly body: SolvedBody,
    private readonly constants: SolverConstants,
  ) {}

  /** The pose at `timeS`; null where nothing is seen, or no pose comes of it: then a new solver is needed. */
  step(seen: Landmarks, timeS: number): Solved | null {
    const observation = observed(seen);
    if (!observation.weights.some((weight) => weight > 0)) return null;
    const found = this.solve(seen, observation, timeS - this.timeS);
    if (![...found.local, ...found.pelvis, found.energy].every(Number.isFinite)) return null;
    [this.last, this.timeS] = [found, timeS];
    const root = found.pelvis.map((value, c) => value - this.body.rest[c]!);
    this.filter.add(found.local, root, timeS);
    return { now: this.filter.pose(0), ahead: this.filter.pose(AHEAD_S), weights: observation.weights };
  }

  private solve(seen: Landmarks, observation: Observation, stepS: number): Found {
    const found: Found[] = [];
    const { body, constants, last } = this;
    if (last && stepS < GAP_S) {
      const precision = new Float64Array(UNKNOWNS).fill((TURNING_RAD_S * stepS) ** -2);
      precision.fill((MOVING_M_S * stepS) ** -2, 3 * JOINT_COUNT);
      found.push(refined(last.local, last.pelvis, body, constants, observation, STEPS, precision));
    }
    const [tracked] = found;
    this.framesSinceLift++;
    if (!tracked || this.framesSinceLift >= LIFT_EVERY || tracked.energy > POOR_FIT * this.typicalEnergy) {
      this.framesSinceLift = 0;
      const { local, pelvis } = this.lifted(seen, observation);
      const steps = tracked ? STEPS : INITIAL_STEPS;
      found.push(refined(local, pelvis, body, constants, observation, steps, NO_PRECISION));
    }
    const best = found.reduce((one, other) => (other.energy < one.energy ? other : one));
    this.typicalEnergy += (tracked ? TYPICAL_SHARE : 1) * (best.energy - this.typicalEnergy);
    return best;
  }

  private lifted(seen: Landmarks, observation: Observation): { local: Numbers; pelvis: Numbers } {
    const { pixels, focal, centre, pixelWeights } = observation;
    const local = lift(pixels, seen.world, seen.visibility, focal, centre, this.constants);
    return { local, pelvis: translation(bodyLandmarks(local, this.body), pixels, pixelWeights, focal, centre) };
  }
}

function observed({ width, height, xy, world, visibility }: Landmarks): Observation {
  const pixels = Float64Array.from(xy, (share, i) => share * (i % 2 ? height : width));
  const weights = Float64Array.from({ length: LANDMARKS }, (_, m) => {
    const [x, y] = [pixels[2 * m]!, pixels[2 * m + 1]!];
    const inside = x >= 0 && y >= 0 && x <= width && y <= height;
    const weight = inside ? visibility[m]! ** 2 : 0;
    if (weight < LEAST_WEIGHT) return 0;
    // ten points of one rigid face must not outweigh the limbs
    return m > 0 && m < FACE_LANDMARKS ? FACE_WEIGHT * weight : weight;
  });
  const pixelWeights = weights.map((weight, m) => {
    if (m < HANDS[0] || m > HANDS[1]) return weight;
    const [x, y] = [pixels[2 * m]!, pixels[2 * m + 1]!];
    const fromEdge = Math.min(x, y, width - x, height - y);
    return weight * Math.min(Math.max(fromEdge / (EDGE * Math.min(width, height)), 0), 1);
  });
  const trunk = [0, 1].map((c) => {
    const at = (m: number): number => pixels[2 * m + c]!;
    return 0.5 * (at(SHOULDERS[0]) - at(HIPS[0]) + at(SHOULDERS[1]) - at(HIPS[1]));
  });
  const tallPx = Math.max(HEIGHTS_A_TRUNK * Math.hypot(...trunk), SMALLEST_HEIGHT_PX);
  return {
    pixels,
    pixelWeights,
    weights,
    world: Float64Array.from(world, (value, i) => (i % 3 ? -value : value)),
    perPixel: 1 / (PIXEL_DEVIATION * tallPx),
    ...usualCamera(width, height),
  };
}

/** Of a webcam's picture of so many px. */
export function usualCamera(width: number, height: number): { focal: number; centre: readonly [number, number] } {
  return { focal: FOCAL * Math.max(width, height), centre: [width / 2, height / 2] };
}

/** Where the pelvis is when `points` (m [33 3], of a body whose pelvis is at the origin) lie on `pixels`, by least squares. */
function translation(
  points: Numbers,
  pixels: Numbers,
  weights: Numbers,
  focal: number,
  centre: readonly [number, number],
): Numbers {
  // u (z + tz) = x + tx on the plane z = 1, v likewise: of the normal equations most numbers are 0
  let [n, u, v, uu, x, y, z] = [1e-9, 0, 0, 1e-9, 0, 0, 0];
  for (let m = 0; m < LANDMARKS; m++) {
    const weight = weights[m]!;
    const [a, b] = [(pixels[2 * m]! - centre[0]) / focal, (pixels[2 * m + 1]! - centre[1]) / focal];
    const depth = -points[3 * m + 2]!;
    const [right, down] = [a * depth - points[3 * m]!, b * depth + points[3 * m + 1]!];
    n += weight;
    u -= weight * a;
    v -= weight * b;
    uu += weight * (a * a + b * b);
    x += weight * right;
    y += weight * down;
    z -= weight * (a * right + b * down);
  }
  const depth = (z - (u * x + v * y) / n) / (uu - (u * u + v * v) / n);
  return Float64Array.of((x - u * depth) / n, -(y - v * depth) / n, -depth);
}
