/**
 * Rotations of a body's joints, as the solver computes with them; the server's twin is scene/kinematics_kernels.py.
 *
 * Matrices lie row by row in longer arrays, each from its own place on; angles are axis-angle, rad.
 */

export type Numbers = Float64Array;

/** As the server's. */
const SMALL_ANGLE = 1e-4;

/** Writes the rotation by the angles x, y, z from `at` on, by Rodrigues' formula. */
export function writeRotation(x: number, y: number, z: number, out: Numbers, at = 0): void {
  const square = x * x + y * y + z * z;
  const angle = Math.sqrt(square);
  const small = angle < SMALL_ANGLE;
  const sine = small ? 1 - square / 6 : Math.sin(angle) / angle;
  const versine = small ? 0.5 - square / 24 : (1 - Math.cos(angle)) / square;
  out[at] = 1 - versine * (y * y + z * z);
  out[at + 4] = 1 - versine * (x * x + z * z);
  out[at + 8] = 1 - versine * (x * x + y * y);
  out[at + 1] = versine * x * y - sine * z;
  out[at + 3] = versine * x * y + sine * z;
  out[at + 2] = versine * x * z + sine * y;
  out[at + 6] = versine * x * z - sine * y;
  out[at + 5] = versine * y * z - sine * x;
  out[at + 7] = versine * y * z + sine * x;
}

const quaternion = new Float64Array(4);

/** Writes the unit quaternion wxyz, w >= 0, of the rotation at `from`, by Shepperd's rule. */
export function writeQuaternion(m: Numbers, from: number, out: Numbers, at = 0): void {
  const xx = m[from]!, yy = m[from + 4]!, zz = m[from + 8]!; // prettier-ignore
  const xy = m[from + 1]! + m[from + 3]!, xz = m[from + 2]! + m[from + 6]!, yz = m[from + 5]! + m[from + 7]!; // prettier-ignore
  const trace = xx + yy + zz;
  let w = 0;
  let x = m[from + 7]! - m[from + 5]!;
  let y = m[from + 2]! - m[from + 6]!;
  let z = m[from + 3]! - m[from + 1]!;
  if (trace >= Math.max(xx, yy, zz)) w = 1 + trace;
  else if (xx >= Math.max(yy, zz)) [w, x, y, z] = [x, 1 + 2 * xx - trace, xy, xz];
  else if (yy >= zz) [w, x, y, z] = [y, xy, 1 + 2 * yy - trace, yz];
  else [w, x, y, z] = [z, xz, yz, 1 + 2 * zz - trace];
  const scale = (w < 0 ? -1 : 1) / Math.sqrt(w * w + x * x + y * y + z * z);
  out[at] = scale * w;
  out[at + 1] = scale * x;
  out[at + 2] = scale * y;
  out[at + 3] = scale * z;
}

/** Writes the angles of the rotation at `from`. */
export function writeAxisAngle(m: Numbers, from: number, out: Numbers, at = 0): void {
  writeQuaternion(m, from, quaternion);
  const w = quaternion[0]!, x = quaternion[1]!, y = quaternion[2]!, z = quaternion[3]!; // prettier-ignore
  const sine = Math.sqrt(x * x + y * y + z * z);
  const angle = 2 * Math.atan2(sine, w);
  const scale = sine < SMALL_ANGLE ? 2 + (angle * angle) / 12 : angle / sine;
  out[at] = x * scale;
  out[at + 1] = y * scale;
  out[at + 2] = z * scale;
}

/** a b; what is written is neither of them. */
export function multiply(a: Numbers, atA: number, b: Numbers, atB: number, out: Numbers, at = 0): void {
  for (let r = 0; r < 9; r += 3) {
    const x = a[atA + r]!, y = a[atA + r + 1]!, z = a[atA + r + 2]!; // prettier-ignore
    for (let c = 0; c < 3; c++) {
      out[at + r + c] = x * b[atB + c]! + y * b[atB + 3 + c]! + z * b[atB + 6 + c]!;
    }
  }
}

/** a^T b; what is written is neither of them. */
export function multiplyTransposed(a: Numbers, atA: number, b: Numbers, atB: number, out: Numbers, at = 0): void {
  for (let r = 0; r < 3; r++) {
    const x = a[atA + r]!, y = a[atA + 3 + r]!, z = a[atA + 6 + r]!; // prettier-ignore
    for (let c = 0; c < 3; c++) {
      out[at + 3 * r + c] = x * b[atB + c]! + y * b[atB + 3 + c]! + z * b[atB + 6 + c]!;
    }
  }
}

/** a b of two matrices, in a new one. */
export function product(a: Numbers, b: Numbers): Numbers {
  const out = new Float64Array(9);
  multiply(a, 0, b, 0, out);
  return out;
}

/** a^T b of two matrices, in a new one. */
export function transposedProduct(a: Numbers, b: Numbers): Numbers {
  const out = new Float64Array(9);
  multiplyTransposed(a, 0, b, 0, out);
  return out;
}

/** The matrix times the vector at `fromVector`, in a new one. */
export function turned(m: Numbers, from: number, v: ArrayLike<number>, fromVector = 0): Numbers {
  const out = new Float64Array(3);
  for (let r = 0; r < 3; r++) {
    for (let c = 0; c < 3; c++) out[r]! += m[from + 3 * r + c]! * v[fromVector + c]!;
  }
  return out;
}

/** The rotation by these angles, in a new matrix. */
export function rotationBy(x: number, y: number, z: number): Numbers {
  const out = new Float64Array(9);
  writeRotation(x, y, z, out);
  return out;
}

/** The angles of a rotation, in a new vector. */
export function anglesOf(m: Numbers, from = 0): Numbers {
  const out = new Float64Array(3);
  writeAxisAngle(m, from, out);
  return out;
}

/** So many rotations that turn nothing. */
export function identities(count: number): Numbers {
  return Float64Array.from({ length: 9 * count }, (_, i) => (i % 9 % 4 === 0 ? 1 : 0));
}

/** The rotations [K 3 3] by `angles` [K 3]. */
export function rotationsBy(angles: Numbers): Numbers {
  const out = new Float64Array(3 * angles.length);
  for (let k = 0; 3 * k < angles.length; k++) {
    writeRotation(angles[3 * k]!, angles[3 * k + 1]!, angles[3 * k + 2]!, out, 9 * k);
  }
  return out;
}

/** The angles [K 3] of `rotations` [K 3 3]. */
export function allAngles(rotations: Numbers): Numbers {
  const out = new Float64Array(rotations.length / 3);
  for (let k = 0; 9 * k < rotations.length; k++) writeAxisAngle(rotations, 9 * k, out, 3 * k);
  return out;
}

const step = new Float64Array(9);

/** The angles [K 3] from the rotations `start` to `end`, in the frames of `start`. */
export function relativeAngles(start: Numbers, end: Numbers): Numbers {
  const out = new Float64Array(start.length / 3);
  for (let k = 0; 9 * k < start.length; k++) {
    multiplyTransposed(start, 9 * k, end, 9 * k, step);
    writeAxisAngle(step, 0, out, 3 * k);
  }
  return out;
}

/** The rotations [K 3 3] R exp(factor v), of `rotations` R and `vectors` v [K 3] in each one's own frame. */
export function integrated(rotations: Numbers, vectors: Numbers, factor: number): Numbers {
  const out = new Float64Array(rotations.length);
  for (let k = 0; 9 * k < rotations.length; k++) {
    writeRotation(factor * vectors[3 * k]!, factor * vectors[3 * k + 1]!, factor * vectors[3 * k + 2]!, step);
    multiply(rotations, 9 * k, step, 0, out, 9 * k);
  }
  return out;
}

/** The rotation `share` of the way from `start` to `end` along the shortest arc. */
export function slerp(start: Numbers, end: Numbers, share: number): Numbers {
  const [x, y, z] = anglesOf(transposedProduct(start, end));
  return product(start, rotationBy(share * x!, share * y!, share * z!));
}

export function lengthOf(v: ArrayLike<number>): number {
  return Math.sqrt(v[0]! * v[0]! + v[1]! * v[1]! + v[2]! * v[2]!);
}

export function dot(a: ArrayLike<number>, b: ArrayLike<number>): number {
  return a[0]! * b[0]! + a[1]! * b[1]! + a[2]! * b[2]!;
}

export function cross(a: ArrayLike<number>, b: ArrayLike<number>): Numbers {
  return Float64Array.of(
    a[1]! * b[2]! - a[2]! * b[1]!,
    a[2]! * b[0]! - a[0]! * b[2]!,
    a[0]! * b[1]! - a[1]! * b[0]!,
  );
}

/** The smallest rotation of the direction `start` into the direction `end`; of opposite ones, one about an axis across. */
export function rotationBetween(start: ArrayLike<number>, end: ArrayLike<number>): Numbers {
  let axis = cross(start, end);
  let sine = lengthOf(axis);
  const angle = Math.atan2(sine, dot(start, end));
  if (sine <= 1e-12 * lengthOf(start) * lengthOf(end)) {
    const sizes = [0, 1, 2].map((c) => Math.abs(start[c]!));
    const weakest = sizes.indexOf(Math.min(...sizes));
    axis = cross(start, [0, 1, 2].map((c) => (c === weakest ? 1 : 0)));
    sine = lengthOf(axis);
  }
  const scale = angle / sine;
  return rotationBy(scale * axis[0]!, scale * axis[1]!, scale * axis[2]!);
}
