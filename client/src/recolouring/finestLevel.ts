/** Live colours are found on the finest level of a person's splats; coarser ones take the mean of theirs. */

import type { SplatFile } from "../splats/file";
import { NEVER } from "../splats/levels";
import type { MovedSplats } from "../splats/moved";

/** A smaller share is none. */
const LEAST_SHARE = 1e-6;

/** The finest level of `file` by itself, and where in the file each of its splats is. */
export function finestLevel(file: SplatFile): { splats: SplatFile; places: Uint32Array } {
  const { levels } = file;
  const all = Uint32Array.from({ length: file.count }, (_, i) => i);
  if (!levels) return { splats: file, places: all };
  const places = all.filter((i) => levels.until[i] === NEVER);
  const splats = {
    ...file,
    count: places.length,
    levels: null,
    positions: taken(file.positions, places, 3),
    covariances: taken(file.covariances, places, 6),
    colours: taken(file.colours, places, 3),
    albedos: taken(file.albedos, places, 3),
    normals: taken(file.normals, places, 3),
    opacities: taken(file.opacities, places, 1),
    captureWeights: taken(file.captureWeights, places, 1),
    joints: taken(file.joints, places, 4),
    weights: taken(file.weights, places, 4),
    moved: movedOf(file.moved, file.count, places),
  };
  return { splats, places };
}

/** RGB of each of the finest splats -> of the splats of all levels. */
export function ofAllLevels({ levels, count }: SplatFile, places: Uint32Array, rgb: Float32Array): Float32Array {
  if (!levels) return rgb;
  const all = new Float32Array(3 * count);
  places.forEach((place, i) => all.set(rgb.subarray(3 * i, 3 * i + 3), 3 * place));
  const replaced = new Uint32Array((count - levels.fewest) / 2);
  levels.until.forEach((until, i) => {
    if (until !== NEVER) replaced[until - levels.fewest - 1] = i;
  });
  for (let split = replaced.length - 1; split >= 0; split--) {
    const first = 3 * (levels.fewest + 2 * split);
    const to = 3 * replaced[split]!;
    for (let c = 0; c < 3; c++) all[to + c] = 0.5 * (all[first + c]! + all[first + 3 + c]!);
  }
  return all;
}

/** Place (x and y) and share of each of the finest splats -> of the splats of all levels; places weigh by their share. */
export function placesOfAllLevels(file: SplatFile, places: Uint32Array, laid: Float32Array): Float32Array {
  const weighed = new Float32Array(laid.length);
  for (let at = 0; at < laid.length; at += 3) {
    const share = laid[at + 2]!;
    weighed[at] = share * laid[at]!;
    weighed[at + 1] = share * laid[at + 1]!;
    weighed[at + 2] = share;
  }
  const all = ofAllLevels(file, places, weighed);
  for (let at = 0; at < all.length; at += 3) {
    const share = Math.max(all[at + 2]!, LEAST_SHARE);
    all[at]! /= share;
    all[at + 1]! /= share;
  }
  return all;
}

function taken<A extends Float32Array | Uint8Array | Int8Array>(values: A, places: Uint32Array, width: number): A {
  const kept = values.slice(0, width * places.length) as A;
  places.forEach((place, i) => kept.set(values.subarray(width * place, width * (place + 1)), width * i));
  return kept;
}

function movedOf({ splats, shapes }: MovedSplats, count: number, places: Uint32Array): MovedSplats {
  const finest = new Int32Array(count).fill(-1);
  places.forEach((place, i) => (finest[place] = i));
  const kept = Uint32Array.from(splats.keys()).filter((row) => finest[splats[row]!]! >= 0);
  const rowOf = new Int32Array(splats.length).fill(-1);
  kept.forEach((row, i) => (rowOf[row] = i));
  return {
    splats: kept.map((row) => finest[splats[row]!]!),
    shapes: shapes.map(({ rows, offsets }) => {
      const here = Uint32Array.from(rows.keys()).filter((i) => rowOf[rows[i]!]! >= 0);
      return { rows: here.map((i) => rowOf[rows[i]!]!), offsets: taken(offsets, here, 3) };
    }),
  };
}
