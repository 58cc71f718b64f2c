/**
 * What a face and hands do, as a few numbers from 0 to 1, from MediaPipe's landmarks alone.
 *
 * Lengths within a face, in 3D and as shares of the distance between the outer corners of the eyes,
 * change with neither distance nor a turn of the head. The server's twin is capture/body/expressions.py;
 * tests hold both to the same numbers (tests/capture/expressions.json).
 */

/** In the order of the server's `EXPRESSION_NAMES`; left and right are the person's own. */
export const EXPRESSION_NAMES = [
  "jaw_open", "blink_left", "blink_right", "brows_up", "smile",
  "look_left", "look_right",
  "left_thumb_curl", "left_index_curl", "left_middle_curl", "left_ring_curl", "left_little_curl",
  "right_thumb_curl", "right_index_curl", "right_middle_curl", "right_ring_curl", "right_little_curl",
] as const; // prettier-ignore
export const EXPRESSION_COUNT = EXPRESSION_NAMES.length;
/** Numbers that are seen, or not, together: bits. */
export const FACE = 1;
export const LEFT_HAND = 2;
export const RIGHT_HAND = 4;
/** Of the first numbers, which are the face's: those of its skin, then those of the eyes. */
export const FACE_NUMBERS = 7;
const SKIN_NUMBERS = 5;
export const FINGER_COUNT = 5;
/**
 * The weight of a blend shape: one of the numbers, or of a finger's second shape 4 c (1 - c) of its curl c
 * (`blend_shape_weights` of the server's scene/expression.py).
 */
export function blendShapeWeight(expression: ArrayLike<number>, shape: number): number {
  if (shape < EXPRESSION_COUNT) return expression[shape] ?? 0;
  const curl = expression[shape - 2 * FINGER_COUNT] ?? 0;
  return 4 * curl * (1 - curl);
}

/** Numbers that earlier versions stored and sent: without the eyes', and at first with one curl a hand. */
export const EARLIER_COUNTS = [SKIN_NUMBERS + 2, SKIN_NUMBERS + 2 * FINGER_COUNT] as const;

export interface ObservedExpression {
  /** 0 to 1 each; without meaning where not known. */
  values: Float32Array;
  /** Bits of the groups that were seen. */
  known: number;
}

/** x, y, z: of a picture's landmarks px, with z as MediaPipe gives it times the picture's width. */
export type Point = readonly [number, number, number];

/** From cheek to cheek, px; of a smaller face the landmarks tell nothing. */
const SMALLEST_FACE_PX = 40;
/** Sine of the turn from which the far side of a face is guessed. */
const MOST_TURNED = 0.7;
const OUTER_CORNERS = [33, 263] as const;
const CHEEKS = [234, 454] as const;
const LIPS = [13, 14] as const;
const IRISES = [468, 473] as const;
const MOUTH_CORNERS = [61, 291] as const;
const LEFT_LIDS = [[385, 380], [386, 374], [387, 373]] as const; // prettier-ignore
const RIGHT_LIDS = [[160, 144], [159, 145], [158, 153]] as const; // prettier-ignore
const LEFT_EYE = [362, 263] as const;
const RIGHT_EYE = [33, 133] as const;
const EYE_CORNERS = [...LEFT_EYE, ...RIGHT_EYE] as const;
const BROWS_TO_LIDS = [[65, 158], [52, 159], [295, 385], [282, 386]] as const; // prettier-ignore
/** As a mouth opens its corners sink and draw together: what lips apart give back. */
const JAW_IN_SMILE = 0.6;
const FOREHEAD = 10;
const UNDER_NOSE = 2;

/** Measures of a face at rest, of people in general. */
export const TYPICAL_RESTING_FACE: readonly number[] = [0.02, 0.27, 0.27, 0.22, -0.2, 0];
/**
 * Where among measures the face at rest is found, percent: talk opens a mouth, blinks are short. Which way
 * straight ahead is (null) does not depend on where somebody looks most.
 */
const REST_PERCENTILES = [10, 65, 65, 40, 30, null] as const;
/** What each measure grows by from rest to fully. */
const FULL_JAW = 0.32;
const FULL_BROWS = 0.045;
const FULL_SMILE = 0.2;
/** By which share lids that are shut have come together. */
const CLOSED = 0.58;
/** How far irises lie before the corners of their eyes, in widths of an eye. */
const IRIS_DEPTH = 0.125;
/** How far irises have moved where eyes look fully aside, likewise. */
const FULL_ASIDE = 0.23;
const WRIST = 0;
/**
 * Index, middle, ring and little finger, and each one's distance from wrist to tip as a share of the way along
 * the bones, as far bent as the body model bends it.
 */
const CHAINS = [
  { joints: [5, 6, 7, 8], bent: 0.5 },
  { joints: [9, 10, 11, 12], bent: 0.46 },
  { joints: [13, 14, 15, 16], bent: 0.46 },
  { joints: [17, 18, 19, 20], bent: 0.53 },
] as const;
/** The same of a finger held straight. */
const FLAT = 0.95;
const THUMB_TO_LITTLE_KNUCKLE = [4, 17] as const;
const PALM = [WRIST, 9] as const;
/** From the thumb's tip to the little finger's knuckle, in palms' lengths, away from the hand and across it. */
const THUMB_OUT = 1.1;
const THUMB_IN = 0.52;

/**
 * Lips apart, left and right lids apart, brows from lids, how wide and high the mouth ends, and how far irises
 * are to the person's left; null for a face that is too small or turned too far.
 */
export function faceMeasures(points: readonly Point[]): number[] | null {
  const [right, left] = OUTER_CORNERS.map((i) => at(points, i)) as [Point, Point];
  const [cheek, other] = CHEEKS.map((i) => at(points, i)) as [Point, Point];
  if (Math.hypot(other[0] - cheek[0], other[1] - cheek[1]) < SMALLEST_FACE_PX) return null;
  const across = subtract(left, right);
  const span = Math.hypot(...across);
  if (Math.abs(across[2]) > MOST_TURNED * span) return null;
  const lips = distance(points, LIPS) / span;
  const brows = BROWS_TO_LIDS.reduce((sum, pair) => sum + distance(points, pair), 0) / BROWS_TO_LIDS.length;
  const leftward = across.map((value) => value / span) as unknown as Point;
  const upward = upwardOf(points, leftward);
  const smile = distance(points, MOUTH_CORNERS) + dot(subtract(mean(points, MOUTH_CORNERS), mean(points, EYE_CORNERS)), upward);
  return [
    lips,
    lidsApart(points, LEFT_LIDS, LEFT_EYE),
    lidsApart(points, RIGHT_LIDS, RIGHT_EYE),
    brows / span,
    smile / span + JAW_IN_SMILE * lips,
    irisesOff(points, leftward, upward),
  ];
}

/** The measures of somebody's face at rest, from those of many pictures. */
export function restingFace(measures: readonly (readonly number[])[]): number[] {
  return REST_PERCENTILES.map((percent, i) => {
    if (percent === null) return TYPICAL_RESTING_FACE[i] ?? 0;
    const sorted = measures.map((one) => one[i] ?? 0).sort((a, b) => a - b);
    const place = ((sorted.length - 1) * percent) / 100;
    const below = sorted[Math.floor(place)] ?? 0;
    const above = sorted[Math.ceil(place)] ?? below;
    return below + (place - Math.floor(place)) * (above - below);
  });
}

/** jaw_open, blink_left, blink_right, brows_up, smile, then where the eyes look. */
export function faceNumbers(measures: readonly number[], rest: readonly number[]): number[] {
  const full = [FULL_JAW, -CLOSED * (rest[1] ?? 0), -CLOSED * (rest[2] ?? 0), FULL_BROWS, FULL_SMILE, FULL_ASIDE];
  const moved = full.map((most, i) => ((measures[i] ?? 0) - (rest[i] ?? 0)) / most);
  const [aside = 0] = moved.splice(SKIN_NUMBERS);
  return [...moved, aside, -aside].map(clamp);
}

/**
 * How far thumb, index, middle, ring and little finger are bent, 0 (flat) to 1 (as in a loose fist), from 21
 * points in any one unit.
 */
export function fingerCurls(points: readonly Point[]): number[] {
  const wrist = at(points, WRIST);
  const fingers = CHAINS.map(({ joints, bent }) => {
    let [along, before] = [0, wrist];
    for (const joint of joints) {
      along += Math.hypot(...subtract(at(points, joint), before));
      before = at(points, joint);
    }
    const share = Math.hypot(...subtract(before, wrist)) / Math.max(along, 1e-9);
    return clamp((FLAT - share) / (FLAT - bent));
  });
  const thumb = distance(points, THUMB_TO_LITTLE_KNUCKLE) / Math.max(distance(points, PALM), 1e-9);
  return [clamp((THUMB_OUT - thumb) / (THUMB_OUT - THUMB_IN)), ...fingers];
}

/** What any version told of a face and hands, for each number of today; `unknown` of what it did not tell of. */
export function ofAnyVersion<Of>(told: ArrayLike<Of>, unknown: Of): Of[] {
  let numbers = Array.from(told);
  if (numbers.length === EARLIER_COUNTS[0]) {
    numbers = numbers.flatMap((of, i) => (i < SKIN_NUMBERS ? [of] : Array<Of>(FINGER_COUNT).fill(of)));
  }
  if (numbers.length === EARLIER_COUNTS[1]) {
    numbers.splice(SKIN_NUMBERS, 0, ...Array<Of>(FACE_NUMBERS - SKIN_NUMBERS).fill(unknown));
  }
  return numbers;
}

/** Learns somebody's face at rest as it goes, of the last minute; at first it is how they look then, mouth shut. */
export class RestingFaceEstimator {
  private readonly measures: number[][] = [];
  private nextMs = -Infinity;

  /** Take what was measured at `timeMs`; the face at rest, as far as is known. */
  update(measures: number[], timeMs: number): number[] {
    if (this.measures.length === 0) {
      const first = [TYPICAL_RESTING_FACE[0] ?? 0, ...measures.slice(1)];
      this.measures.push(...Array.from({ length: FIRST }, () => first));
    }
    if (timeMs >= this.nextMs) {
      this.nextMs = timeMs + EVERY_MS;
      this.measures.push(measures);
      if (this.measures.length > KEPT) this.measures.shift();
    }
    return restingFace(this.measures);
  }
}

const FIRST = 8;
const EVERY_MS = 250;
const KEPT = 240;

function at(points: readonly Point[], i: number): Point {
  return points[i] ?? [0, 0, 0];
}

function subtract(a: Point, b: Point): [number, number, number] {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

function distance(points: readonly Point[], [a, b]: readonly [number, number]): number {
  return Math.hypot(...subtract(at(points, a), at(points, b)));
}

function lidsApart(
  points: readonly Point[],
  pairs: readonly (readonly [number, number])[],
  corners: readonly [number, number],
): number {
  const sum = pairs.reduce((all, pair) => all + distance(points, pair), 0);
  return sum / pairs.length / distance(points, corners);
}

/** Along the face, unit length. */
function upwardOf(points: readonly Point[], leftward: Point): Point {
  const nose = subtract(at(points, FOREHEAD), at(points, UNDER_NOSE));
  const along = dot(nose, leftward);
  const up = nose.map((value, i) => value - along * (leftward[i] ?? 0));
  return up.map((value) => value / Math.hypot(...up)) as unknown as Point;
}

/**
 * How far the irises are to the person's left from the middle of their eyes' corners, in widths of an eye. Their depth is not measured, so only the picture counts: a face that turns moves them aside by as much as
 * they lie before the corners.
 */
function irisesOff(points: readonly Point[], left: Point, up: Point): number {
  const width = 0.5 * (distance(points, LEFT_EYE) + distance(points, RIGHT_EYE));
  const off = subtract(mean(points, IRISES), mean(points, EYE_CORNERS)).map((value) => value / width);
  const x = (off[0] ?? 0) - IRIS_DEPTH * (left[1] * up[2] - left[2] * up[1]);
  const y = (off[1] ?? 0) - IRIS_DEPTH * (left[2] * up[0] - left[0] * up[2]);
  return (x * up[1] - y * up[0]) / (left[0] * up[1] - left[1] * up[0]);
}

function mean(points: readonly Point[], which: readonly number[]): Point {
  const sum = [0, 1, 2].map((k) => which.reduce((all, i) => all + (at(points, i)[k] ?? 0), 0));
  return sum.map((value) => value / which.length) as unknown as Point;
}

function dot(a: Point, b: Point): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function clamp(value: number): number {
  return Math.max(0, Math.min(1, value));
}
