/** Landmarks in 3D to the rotations of a body's joints, in closed form; the server's twin is capture/body/inverse_kinematics.py. */

import {
  ELBOW_HINGE, FACE_LANDMARKS, HEAD, HIPS, JOINT_COUNT, LEFT, NECK, PARENTS, RIGHT, SHOULDERS, SPINE1, SPINE2, SPINE3,
} from "./body"; // prettier-ignore
import {
  allAngles, anglesOf, cross, dot, identities, lengthOf, multiplyTransposed, product, rotationBetween, rotationBy, rotationsBy,
  transposedProduct, turned,
  type Numbers,
} from "./rotations"; // prettier-ignore
import { bestRotation } from "./bestRotation";

const VISIBLE = 0.5;
/** Sine of the bend between which a hinge's axis goes from the parent's to the seen one. */
const [BENT_FROM, FULLY_BENT] = [0.15, 0.5];
const MOST_AT_WRIST_RAD = 1.2;
const MOST_AT_ANKLE_RAD = 1;
const SIDES = [
  { joints: LEFT, sign: 1, hinge: ELBOW_HINGE.left, first: 0 },
  { joints: RIGHT, sign: -1, hinge: ELBOW_HINGE.right, first: 1 },
] as const;
type Side = (typeof SIDES)[number];
/** MediaPipe's numbers of the left side; those of the right follow each. */
const [ELBOW, WRIST, PINKY, INDEX, KNEE, ANKLE, HEEL, TOE] = [13, 15, 17, 19, 25, 27, 29, 31] as const;

/** A body that is worked out. */
class Pose {
  readonly rotations = identities(JOINT_COUNT);

  constructor(
    readonly points: Numbers,
    private readonly visibility: ArrayLike<number>,
  ) {}

  put(joint: number, rotation: Numbers): void {
    this.rotations.set(rotation, 9 * joint);
  }

  of(joint: number): Numbers {
    return this.rotations.subarray(9 * joint, 9 * joint + 9);
  }

  /** From one landmark to another. */
  between(from: number, to: number): Numbers {
    return Float64Array.from({ length: 3 }, (_, c) => this.points[3 * to + c]! - this.points[3 * from + c]!);
  }

  shows(...landmarks: number[]): boolean {
    return landmarks.every((i) => this.visibility[i]! >= VISIBLE);
  }
}

/** Rotations relative to the parents [24 3 3] of the body seen as `points` (m [33 3], y up, z towards the camera). */
export function solvePose(points: Numbers, visibility: ArrayLike<number>, typicalLandmarks: Numbers): Numbers {
  const pose = new Pose(points, visibility);
  solveTrunk(pose, typicalLandmarks);
  for (const side of SIDES) {
    solveArm(pose, side);
    solveLeg(pose, side, typicalLandmarks);
  }
  // hinges are not quite of unit length, which leaves rotations that are not quite such
  return rotationsBy(allAngles(relativeToParents(pose.rotations)));
}

/** The same rotations relative to the parents'. */
export function relativeToParents(world: Numbers): Numbers {
  const local = world.slice();
  for (let k = 1; k < JOINT_COUNT; k++) multiplyTransposed(world, 9 * PARENTS[k]!, world, 9 * k, local, 9 * k);
  return local;
}

function solveTrunk(pose: Pose, typical: Numbers): void {
  const { points } = pose;
  const up = Float64Array.from({ length: 3 }, (_, c) => {
    const shoulders = points[3 * SHOULDERS[0] + c]! + points[3 * SHOULDERS[1] + c]!;
    return shoulders - points[3 * HIPS[0] + c]! - points[3 * HIPS[1] + c]!;
  });
  const hips = frame(pose.between(HIPS[1], HIPS[0]), up);
  const chest = frame(pose.between(SHOULDERS[1], SHOULDERS[0]), up);
  const head = bestRotation(typical, points, FACE_LANDMARKS);
  pose.put(0, hips);
  const twist = anglesOf(transposedProduct(hips, chest));
  for (const [share, joint] of [[1 / 3, SPINE1], [2 / 3, SPINE2], [1, SPINE3]] as const) pose.put(joint, after(hips, twist, share)); // prettier-ignore
  pose.put(LEFT.collar, chest);
  pose.put(RIGHT.collar, chest);
  pose.put(NECK, after(chest, anglesOf(transposedProduct(chest, head)), 0.5));
  pose.put(HEAD, head);
}

function solveArm(pose: Pose, { joints, sign, hinge, first }: Side): void {
  const [shoulder, elbow, wrist] = [SHOULDERS[first], ELBOW + first, WRIST + first];
  const along = [sign, 0, 0];
  const chest = pose.of(joints.collar);
  let upper = product(chest, rotationBetween(along, [0, -1, 0]));
  let fore = upper;
  let hand = upper;
  if (pose.shows(elbow)) {
    const [bone, second] = twoBones(chest, pose.between(shoulder, elbow), pose.between(elbow, wrist), along, hinge);
    upper = bone;
    fore = hand = pose.shows(wrist) ? second : upper;
    if (pose.shows(wrist)) {
      const [toIndex, toPinky] = [pose.between(wrist, INDEX + first), pose.between(wrist, PINKY + first)];
      const fingers = Float64Array.from({ length: 3 }, (_, c) => sign * 0.5 * (toIndex[c]! + toPinky[c]!));
      const palm = frame(fingers, cross(pose.between(PINKY + first, INDEX + first), fingers));
      hand = limited(fore, palm, MOST_AT_WRIST_RAD);
    }
  }
  // a rotated palm rotates the forearm too: half of the twist belongs to the elbow
  const twist = anglesOf(transposedProduct(fore, hand));
  pose.put(joints.shoulder, upper);
  pose.put(joints.elbow, product(fore, rotationBy(0.5 * twist[0]!, 0, 0)));
  pose.put(joints.wrist, hand);
  pose.put(joints.hand, hand);
}

function solveLeg(pose: Pose, { joints, first }: Side, typical: Numbers): void {
  const [hip, knee, ankle, heel, toe] = [HIPS[first], KNEE + first, ANKLE + first, HEEL + first, TOE + first];
  const pelvis = pose.of(0);
  let [thigh, shin, foot]: [Numbers, Numbers, Numbers] = [pelvis, pelvis, pelvis];
  if (pose.shows(knee)) {
    const [bone, second] = twoBones(pelvis, pose.between(hip, knee), pose.between(knee, ankle), [0, -1, 0], [1, 0, 0]);
    thigh = bone;
    shin = foot = pose.shows(ankle) ? second : thigh;
    if (pose.shows(ankle, heel, toe)) {
      const rest = Float64Array.from({ length: 3 }, (_, c) => typical[3 * toe + c]! - typical[3 * heel + c]!);
      foot = limited(shin, swing(shin, rest, pose.between(heel, toe)), MOST_AT_ANKLE_RAD);
    }
  }
  pose.put(joints.hip, thigh);
  pose.put(joints.knee, shin);
  pose.put(joints.ankle, foot);
  pose.put(joints.foot, foot);
}

/** World rotations of two bones that lie `along` at rest and bend about `hinge`. */
function twoBones(
  parent: Numbers,
  first: Numbers,
  second: Numbers,
  along: readonly number[],
  hinge: readonly number[],
): [Numbers, Numbers] {
  const a = unit(nonzeroOr(first, turned(parent, 0, along)));
  const b = unit(nonzeroOr(second, a));
  const normal = cross(a, b);
  const sine = lengthOf(normal);
  const parentHinge = turned(swing(parent, along, first), 0, hinge);
  // a hinge opens one way only: an observed axis opposite to the parent's is an error in depth
  const opens = dot(normal, parentHinge) > -0.3 * sine;
  const seen = opens ? Math.min(Math.max((sine - BENT_FROM) / (FULLY_BENT - BENT_FROM), 0), 1) : 0;
  const axis = normal.map((value, c) => (seen * value) / Math.max(sine, 1e-9) + (1 - seen) * parentHinge[c]!);
  const b2 = unit(axis.map((value, c) => value - dot(axis, a) * a[c]!));
  const rest = columns(along, hinge, cross(along, hinge));
  const upper = product(columns(a, b2, cross(a, b2)), transposed(rest));
  return [upper, swing(upper, along, second)];
}

/** `parent` after the least rotation that takes its `rest` direction to `observed`. */
function swing(parent: Numbers, rest: ArrayLike<number>, observed: Numbers): Numbers {
  const current = turned(parent, 0, rest);
  return product(rotationBetween(current, nonzeroOr(observed, current)), parent);
}

/** The rotation whose x axis is along `x` and whose y axis is nearest to `y`; none where they are in line. */
function frame(x: Numbers, y: Numbers): Numbers {
  const right = unit(x);
  const up = unit(y.map((value, c) => value - dot(y, right) * right[c]!));
  const forwards = cross(right, up);
  return dot(forwards, forwards) > 0.5 ? columns(right, up, forwards) : identities(1);
}

/** `child` brought to within `angle` of `parent`. */
function limited(parent: Numbers, child: Numbers, angle: number): Numbers {
  const rotation = anglesOf(transposedProduct(parent, child));
  const size = lengthOf(rotation);
  return after(parent, rotation, Math.min(size, angle) / Math.max(size, 1e-9));
}

function after(parent: Numbers, angles: Numbers, share: number): Numbers {
  return product(parent, rotationBy(share * angles[0]!, share * angles[1]!, share * angles[2]!));
}

function columns(a: ArrayLike<number>, b: ArrayLike<number>, c: ArrayLike<number>): Numbers {
  return Float64Array.of(a[0]!, b[0]!, c[0]!, a[1]!, b[1]!, c[1]!, a[2]!, b[2]!, c[2]!);
}

function transposed(m: Numbers): Numbers {
  return columns(m.subarray(0, 3), m.subarray(3, 6), m.subarray(6, 9));
}

function nonzeroOr(direction: Numbers, other: Numbers): Numbers {
  return lengthOf(direction) < 1e-9 ? other : direction;
}

/** Of length one; zero stays zero. */
function unit(vector: Numbers): Numbers {
  const length = Math.max(lengthOf(vector), 1e-9);
  return vector.map((value) => value / length);
}
