/**
 * A person's splats as the server hands them out (docs/viewer-file.md tells the layout).
 *
 * 32 bytes a splat: roots first, then splits, each with the two splats that take one's place. 7 bytes
 * more for each splat that a face or hand moves, by each number of an expression. Files of version 6 have
 * no levels: their splats come the most important first, and the first n alone are a model, once their
 * scales are multiplied by (N / n)^1/4. Those of version 5 have no offsets for the eyes, those of version
 * 4 offsets for whole hands.
 */

import { EARLIER_COUNTS, FINGER_COUNT, ofAnyVersion } from "../landmarks/expression";
import { rotationMatrix, smallestThree } from "../viewpoint/geometry";
import { NEVER, nodesOf, type Levels } from "./levels";
import { movedSplats, NOTHING_MOVES, type BlendShape, type MovedSplats } from "./moved";

const MAGIC = "MNSP";
const VERSION = 7;
const PLAIN_VERSION = 6;
const EYELESS_VERSION = 5;
const WHOLE_HANDS_VERSION = 4;
const LIGHT_AT = 44;
/** Three colours of nine harmonics. */
const LIGHT_NUMBERS = 27;
const MOVED_AT = LIGHT_AT + 4 * LIGHT_NUMBERS;
const ROOTS_AT = MOVED_AT + 8;
const PLAIN_HEAD_BYTES = ROOTS_AT;
const RECORD_BYTES = 32;
/** Which record is replaced, and the two in its place. */
const SPLIT_BYTES = 4 + 2 * RECORD_BYTES;
/** Of an expression, and of each splat that it moves. */
const SHAPE_BYTES = 8;
const OFFSET_BYTES = 7;
const EARLIER_MOVED_BYTES = 28;
const ROTATION_STEPS = 1023;

/** The splats of one person at rest. */
export interface SplatFile {
  /** Splats of all levels: places in the arrays. */
  count: number;
  /** Null: of files without levels, the first so many alone are a model. */
  levels: Levels | null;
  /** x, y, z of each, m. */
  positions: Float32Array;
  /** xx, xy, xz, yy, yz, zz of each one's covariance, m^2. */
  covariances: Float32Array;
  /** Harmonics of the light of their clip, RGB by RGB; null where it is not known. */
  light: Float32Array | null;
  /** Mean sRGB of each as filmed, 0 to 255. */
  colours: Uint8Array;
  /** sRGB of each without the light it was filmed in, 0 to 255. */
  albedos: Uint8Array;
  /** Outward x, y, z of the surface at rest, 127 long. */
  normals: Int8Array;
  /** 0 to 255. */
  opacities: Uint8Array;
  /** Factor of each one's opacity where unseen parts are hidden, 0 to 255. */
  captureWeights: Uint8Array;
  /** Four joints of each, and their weights, which sum to 255. */
  joints: Uint8Array;
  weights: Uint8Array;
  /** x, y, z of each joint, m. */
  restJoints: Float32Array;
  /** Of each joint; -1: none. A parent comes before its children. */
  parents: Int16Array;
  moved: MovedSplats;
}

/** What the head of a file tells of its layout. */
interface Layout {
  version: number;
  joints: number;
  joinsAt: number;
  start: number;
  whole: number;
  /** Of a file without levels: all. */
  roots: number;
  movedStart: number;
}

function layoutOf(data: DataView): Layout {
  const magic = data.byteLength < ROOTS_AT + 4 ? "" : String.fromCharCode(...new Uint8Array(data.buffer, 0, 4));
  const version = magic === MAGIC ? data.getUint16(4, true) : 0;
  if (version > VERSION || version < WHOLE_HANDS_VERSION) {
    throw new Error(`a file of splats must begin with ${MAGIC}, version ${VERSION}; got ${magic || "less"}`);
  }
  const [joints, whole] = [data.getUint16(6, true), data.getUint32(8, true)];
  const plain = version <= PLAIN_VERSION;
  const roots = plain ? whole : data.getUint32(ROOTS_AT, true);
  const joinsAt = plain ? PLAIN_HEAD_BYTES : ROOTS_AT + 4;
  const start = joinsAt + 14 * joints;
  return { version, joints, joinsAt, start, whole, roots, movedStart: start + RECORD_BYTES * roots + SPLIT_BYTES * (whole - roots) };
}

/** Splats of the finest level whose records are among the first `bytes`. */
function splatsWithin({ start, whole, roots }: Layout, bytes: number): number {
  const rest = bytes - start - RECORD_BYTES * roots;
  const here = rest < 0 ? Math.floor((bytes - start) / RECORD_BYTES) : roots + Math.floor(rest / SPLIT_BYTES);
  return Math.max(0, Math.min(whole, here));
}

/**
 * The first `share` of the splats of a file. Of a `beginning`, bytes of which more are to come, those
 * that are here, at rest. Throws for what is no such file.
 */
export function readSplats(bytes: ArrayBuffer, share = 1, beginning = false): SplatFile {
  const data = new DataView(bytes);
  const layout = layoutOf(data);
  const { version, joints, joinsAt, start, whole, roots, movedStart } = layout;
  const wanted = movedStart + movedBytes(data, version);
  const complete = bytes.byteLength === wanted;
  if (!complete && !(beginning && bytes.byteLength < wanted)) {
    throw new Error(`a file of ${whole} splats must have ${wanted} bytes; got ${bytes.byteLength}`);
  }
  const bounds = Array.from({ length: 8 }, (_, i) => data.getFloat32(12 + 4 * i, true));
  const here = Math.round(splatsWithin(layout, bytes.byteLength) * share);
  const levels = version <= PLAIN_VERSION ? null : readLevels(data, layout, here);
  const file = { ...emptyFile(nodesOf(levels, here), joints), levels };
  file.restJoints.forEach((_, i) => {
    file.restJoints[i] = data.getFloat32(joinsAt + 4 * i, true);
  });
  file.parents.forEach((_, i) => {
    file.parents[i] = data.getInt16(joinsAt + 12 * joints + 2 * i, true);
  });
  const light = Float32Array.from({ length: LIGHT_NUMBERS }, (_, i) => data.getFloat32(LIGHT_AT + 4 * i, true));
  file.light = light.some((value) => value !== 0) ? light : null;
  if (complete) {
    const shapesOf = version === WHOLE_HANDS_VERSION ? readWholeHandShapes : readShapes;
    file.moved = movedSplats(shapesOf(data, movedStart, file.count), file.count);
  }
  const growth = levels ? 1 : varianceScale(whole, file.count);
  for (let i = 0; i < file.count; i++) {
    const splits = i < roots ? 0 : 1 + ((i - roots) >> 1);
    readRecord(data, start + i * RECORD_BYTES + 4 * splits, i, bounds, growth, file);
  }
  return file;
}

/** The levels of a file up to that of `count` splats. */
function readLevels(data: DataView, { start, roots }: Layout, count: number): Levels {
  const fewest = Math.min(roots, count);
  const until = new Uint32Array(nodesOf({ fewest }, count)).fill(NEVER);
  for (let split = 0; split < count - fewest; split++) {
    until[data.getUint32(start + RECORD_BYTES * roots + SPLIT_BYTES * split, true)] = fewest + split + 1;
  }
  return { fewest, until };
}

/** Factor of the variances where only the first `kept` of `whole` splats are drawn. */
function varianceScale(whole: number, kept: number): number {
  return Math.sqrt(whole / Math.max(kept, 1));
}

/** Factor of each person's variances where `kept` of their splats are drawn: levels have their own. */
export function growths(people: readonly SplatFile[], kept: readonly number[]): number[] {
  return people.map(({ levels, count }, at) => (levels ? 1 : varianceScale(count, kept[at] ?? count)));
}

function emptyFile(count: number, joints: number): SplatFile {
  return {
    count,
    levels: null,
    positions: new Float32Array(3 * count),
    covariances: new Float32Array(6 * count),
    light: null,
    colours: new Uint8Array(3 * count),
    albedos: new Uint8Array(3 * count),
    normals: new Int8Array(3 * count),
    opacities: new Uint8Array(count),
    captureWeights: new Uint8Array(count),
    joints: new Uint8Array(4 * count),
    weights: new Uint8Array(4 * count),
    restJoints: new Float32Array(3 * joints),
    parents: new Int16Array(joints),
    moved: NOTHING_MOVES,
  };
}

function movedBytes(data: DataView, version: number): number {
  const first = data.getUint32(MOVED_AT, true);
  if (version === WHOLE_HANDS_VERSION) return EARLIER_MOVED_BYTES * first;
  return SHAPE_BYTES * first + OFFSET_BYTES * data.getUint32(MOVED_AT + 4, true);
}

/** The blend shapes at `start`, of the first `count` splats. */
function readShapes(data: DataView, start: number, count: number): BlendShape[] {
  const expressions = data.getUint32(MOVED_AT, true);
  let index = start + SHAPE_BYTES * expressions;
  let offset = index + 4 * data.getUint32(MOVED_AT + 4, true);
  const shapes = Array.from({ length: expressions }, (_, e) => {
    const splats = Uint32Array.from({ length: data.getUint32(start + SHAPE_BYTES * e, true) }, (_, i) =>
      data.getUint32(index + 4 * i, true),
    );
    const unitM = data.getFloat32(start + SHAPE_BYTES * e + 4, true) / 127;
    const offsets = Float32Array.from(new Int8Array(data.buffer, offset, 3 * splats.length), (step) => step * unitM);
    index += 4 * splats.length;
    offset += 3 * splats.length;
    const kept = splats.findIndex((splat) => splat >= count);
    return kept < 0 ? { splats, offsets } : { splats: splats.slice(0, kept), offsets: offsets.slice(0, 3 * kept) };
  });
  if (data.getUint16(4, true) > EYELESS_VERSION) return shapes;
  const inBetweens = shapes.splice(EARLIER_COUNTS[1]);
  return [...ofAnyVersion(shapes, STILL), ...inBetweens];
}

/** A blend shape that moves nothing. */
const STILL: BlendShape = { splats: new Uint32Array(0), offsets: new Float32Array(0) };

/** The same of version 4, which has offsets of whole hands: each finger takes an equal share. */
function readWholeHandShapes(data: DataView, start: number, count: number): BlendShape[] {
  const unitM = data.getFloat32(MOVED_AT + 4, true) / 127;
  const shapes = Array.from({ length: EARLIER_COUNTS[0] }, (_, e) => {
    const share = e < EARLIER_COUNTS[0] - 2 ? 1 : 1 / FINGER_COUNT;
    const [splats, offsets]: [number[], number[]] = [[], []];
    for (let at = start; at < data.byteLength; at += EARLIER_MOVED_BYTES) {
      const splat = data.getUint32(at, true);
      const steps = new Int8Array(data.buffer, at + 4 + 3 * e, 3);
      if (splat >= count || !steps.some(Boolean)) continue;
      splats.push(splat);
      offsets.push(...Array.from(steps, (step) => step * unitM * share));
    }
    return { splats: Uint32Array.from(splats), offsets: Float32Array.from(offsets) };
  });
  return ofAnyVersion(shapes, STILL);
}

function readRecord(
  data: DataView,
  at: number,
  i: number,
  bounds: readonly number[],
  growth: number,
  file: SplatFile,
): void {
  const variances = [0, 0, 0];
  const [thin = 0, wide = 0] = [bounds[6], bounds[7]];
  for (let axis = 0; axis < 3; axis++) {
    const [low = 0, high = 0] = [bounds[axis], bounds[axis + 3]];
    file.positions[3 * i + axis] = low + (data.getUint16(at + 2 * axis, true) / 65535) * (high - low);
    const logScale = thin + (data.getUint8(at + 6 + axis) / 255) * (wide - thin);
    variances[axis] = growth * Math.exp(2 * logScale);
    file.colours[3 * i + axis] = data.getUint8(at + 14 + axis);
    file.albedos[3 * i + axis] = data.getUint8(at + 26 + axis);
    file.normals[3 * i + axis] = data.getInt8(at + 29 + axis);
  }
  file.captureWeights[i] = data.getUint8(at + 9);
  file.opacities[i] = data.getUint8(at + 17);
  const rotation = rotationOf(data.getUint32(at + 10, true));
  let place = 6 * i;
  for (let r = 0; r < 3; r++) {
    for (let c = r; c < 3; c++) {
      let sum = 0;
      for (let k = 0; k < 3; k++) {
        sum += (rotation[3 * r + k] ?? 0) * (variances[k] ?? 0) * (rotation[3 * c + k] ?? 0);
      }
      file.covariances[place++] = sum;
    }
  }
  for (let k = 0; k < 4; k++) {
    file.joints[4 * i + k] = data.getUint8(at + 18 + k);
    file.weights[4 * i + k] = data.getUint8(at + 22 + k);
  }
}

function rotationOf(packed: number): number[] {
  const three = [packed & 1023, (packed >>> 10) & 1023, (packed >>> 20) & 1023];
  return rotationMatrix(smallestThree(three, packed >>> 30, ROTATION_STEPS));
}
