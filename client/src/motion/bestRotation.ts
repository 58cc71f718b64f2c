/** The rotation between two sets of points. */

import { largestEigenvector } from "./eigenvector";
import type { Numbers } from "./rotations";

/** The rotation that best maps the first `count` of the points `rest` to `observed` (Horn 1987). */
export function bestRotation(rest: Numbers, observed: Numbers, count: number): Numbers {
  const [a, b] = [meanOf(rest, count), meanOf(observed, count)];
  const s = new Float64Array(9);
  for (let n = 0; n < count; n++) {
    for (let r = 0; r < 3; r++) {
      for (let c = 0; c < 3; c++) s[3 * r + c]! += (rest[3 * n + r]! - a[r]!) * (observed[3 * n + c]! - b[c]!);
    }
  }
  const [xx, xy, xz, yx, yy, yz, zx, zy, zz] = s as unknown as number[] & { length: 9 };
  const [w, x, y, z] = largestEigenvector([
    [xx! + yy! + zz!, yz! - zy!, zx! - xz!, xy! - yx!],
    [yz! - zy!, xx! - yy! - zz!, xy! + yx!, zx! + xz!],
    [zx! - xz!, xy! + yx!, yy! - xx! - zz!, yz! + zy!],
    [xy! - yx!, zx! + xz!, yz! + zy!, zz! - xx! - yy!],
  ]) as [number, number, number, number];
  return Float64Array.of(
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ); // prettier-ignore
}

function meanOf(points: Numbers, count: number): number[] {
  return [0, 1, 2].map((c) => {
    let sum = 0;
    for (let n = 0; n < count; n++) sum += points[3 * n + c]!;
    return sum / count;
  });
}
