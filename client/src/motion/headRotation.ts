/** How a head is turned by its face's points; the server's twin is `head_rotation` of capture/detection/rigid_parts.py. */

import type { ObservedHead } from "../landmarks/head";
import { bestRotation } from "./bestRotation";
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
  return bestRotation(rest, seen, points.length);
}
