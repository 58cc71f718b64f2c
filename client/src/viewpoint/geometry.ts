/** Numbers with a place in space, and rotations. */

export type Vec3 = readonly [number, number, number];
/** Unit quaternion, real part first. */
export type Quaternion = readonly [number, number, number, number];

/**
 * The unit quaternion wxyz of which component `largest` was left out; the other three, in their
 * order, are given in `steps` from -1/sqrt(2) to 1/sqrt(2).
 */
export function smallestThree(three: readonly number[], largest: number, steps: number): number[] {
  const others = three.map((level) => ((2 * level) / steps - 1) * Math.SQRT1_2);
  const rest = Math.max(0, 1 - others.reduce((sum, value) => sum + value * value, 0));
  others.splice(largest, 0, Math.sqrt(rest));
  return others;
}

/** The rotation matrix, row by row, of a unit quaternion wxyz. */
export function rotationMatrix([w = 1, x = 0, y = 0, z = 0]: readonly number[]): number[] {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}
