/** How a head is turned by its face's points; the server's twin is `head_rotation` of capture/detection/rigid_parts.py. */

import type { ObservedHead } from "../landmarks/head";
import { largestEigenvector } from "./eigenvector";
import { product, rotationBetween, turned, type Numbers } from "./rotations";

/** From OpenCV's axes to OpenGL's. */
const TO_OPENGL = Float64Array.of(1, 0, 0, 0, -1, 0, 0, 0, -1);

/** From rest to the camera, x right, y up, z towards it; `rest` are the points at rest, m [33 3]. */
export function headRotation(
  { middle, points }: ObservedHead,
  rest: Numbers,
  focal: number,
  centre: readonly [number, number],
): Numbers {
  const ray = [(middle[0] - centre[0]) / focal, (middle[1] - centre[1]) / focal, 1];
  const toCamera = product(TO_OPENGL, rotationBetween([0, 0, 1], ray));
  const seen = Float64Array.from(points.flatMap((point) => [...turned(toCamera, 0, point)]));
  return bestRotation(centred(rest), centred(seen));
}

function centred(points: Numbers): Numbers {
  const count = points.length / 3;
  const mean = [0, 1, 2].map((c) => points.reduce((sum, value, i) => sum + (i % 3 === c ? value : 0), 0) / count);
  return points.map((value, i) => value - mean[i % 3]!);
}

/** The rotation that brings `a` nearest to `b` [P 3], whatever the scale of either (Horn 1987, section 4). */
function bestRotation(a: Numbers, b: Numbers): Numbers {
  const s = (p: number, q: number): number => a.reduce((sum, value, i) => (i % 3 === p ? sum + value * b[i - p + q]! : sum), 0);
  const [xx, xy, xz, yx, yy, yz, zx, zy, zz] = [0, 1, 2].flatMap((p) => [0, 1, 2].map((q) => s(p, q))) as [
    number, number, number, number, number, number, number, number, number,
  ]; // prettier-ignore
  const [w, x, y, z] = largestEigenvector([
    [xx + yy + zz, yz - zy, zx - xz, xy - yx],
    [yz - zy, xx - yy - zz, xy + yx, zx + xz],
    [zx - xz, xy + yx, yy - xx - zz, yz + zy],
    [xy - yx, zx + xz, yz + zy, zz - xx - yy],
  ]) as [number, number, number, number];
  return Float64Array.of(
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ); // prettier-ignore
}
