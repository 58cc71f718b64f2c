/** The server's solver, its constants and what it made of real landmarks, for tests that hold the page's to it. */

import { unzipSync } from "fflate";
import weights from "../../../capture/assets/lifter.npz?url&inline";
import motion from "../../../tests/services/live/motion.json";
import type { Landmarks } from "../../src/landmarks/landmarks";
import type { ObservedExpression, Point } from "../../src/landmarks/expression";
import { HEAD_POINTS, type ObservedHead } from "../../src/landmarks/head";
import { rotationBy, turned } from "../../src/motion/rotations";
import type { SolvedBody, SolverConstants } from "../../src/motion/body";
import { CONSTANTS_BYTES, WEIGHTS, readConstants } from "../../src/motion/constants";

const { people, cases } = motion;
/** A picture's landmarks, and what the server made of them. */
export type Frame = (typeof cases)[number]["frames"][number];
export const CASES = cases;

/** The file as the server sends it, from what it is made of. */
export function constantsFile(): ArrayBuffer {
  const packed = Uint8Array.from(atob(weights.slice(weights.indexOf(",") + 1)), (one) => one.charCodeAt(0));
  const arrays = unzipSync(packed);
  const file = new Uint8Array(CONSTANTS_BYTES);
  const numbers = Float32Array.from([...people.mean, ...people.axes, ...people.stiffness, ...people.landmarks, ...people.head]);
  file.set(new Uint8Array(numbers.buffer));
  let at = numbers.byteLength;
  for (const [name, count] of WEIGHTS) {
    const array = arrays[`${name}.npy`]!;
    file.set(array.subarray(array.length - 2 * count), at);
    at += 2 * count;
  }
  return file.buffer;
}

export const CONSTANTS: SolverConstants = readConstants(constantsFile());

export function bodyOf({ body }: (typeof cases)[number]): SolvedBody {
  const whole = (values: readonly number[]): Float64Array => Float64Array.from(Float32Array.from(values));
  return { rest: whole(body.rest), landmarks: whole(body.landmarks), yaw: body.yaw };
}

export function seenIn(frame: Frame): Landmarks {
  const { width, height } = frame;
  const [xy, world, visibility] = [frame.xy, frame.world, frame.visibility].map((one) => Float32Array.from(one));
  return { width, height, xy: xy!, world: world!, visibility: visibility! };
}

/** Points of a face in the middle of the picture whose head is turned so. */
export function headIn({ head, time_ms, width, height }: Frame): ObservedHead | null {
  if (!head) return null;
  const rotation = rotationBy(head[0]!, head[1]!, head[2]!);
  const points = HEAD_POINTS.map((_, i): Point => {
    const [x, y, z] = turned(rotation, 0, CONSTANTS.headPoints, 3 * i) as unknown as Point;
    return [1000 * x, -1000 * y, -1000 * z];
  });
  return { middle: [width / 2, height / 2], points, timeMs: time_ms };
}

/** A face's points, and how the server finds that its head is turned. */
export const FACE = motion.head;

export function expressionIn({ expression }: Frame): ObservedExpression | null {
  return expression && { values: Float32Array.from(expression.values), known: expression.known };
}
