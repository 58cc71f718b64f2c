/**
 * A webcam's picture laid on its person: detail that is finer than splats, renderer/splats/rasteriser/laying.py.
 *
 * Each splat knows where its centre is in the picture, and a pixel of the drawn picture is as far beside that as it is
 * beside the drawn centre, in the scale of both. From beside the webcam the picture fades. No graphics card in here.
 */

import { PICTURE_PX } from "../look/cutOut";
import type { Vec3 } from "../viewpoint/geometry";
import type { PassCamera } from "./camera";
import { transformed, TRANSFORM } from "./skeleton";

/** What somebody's webcam shows of them and the colours of their splats are too coarse for. */
export interface LaidPicture {
  /** Factors of the colours that are drawn at the webcam's place, see `packDetail`: `PICTURE_PX` squared. */
  detail: Uint32Array<ArrayBuffer>;
  /** Where each splat's centre is in the picture, and how well it is seen, see `packPlaces`. */
  places: Uint32Array<ArrayBuffer>;
  /** Where the webcam is as the chest sees it: at rest, m. */
  webcam: Vec3;
  /** Horizontal focal length of the picture. */
  focalPx: number;
}

/** How a picture is laid on in one view. */
export interface Laying {
  /** 0 to 1. */
  strength: number;
  /** px of the picture for one of the view. */
  scale: number;
}

export const CHEST = 9;
/** Angle beside the webcam up to which a picture is laid on in full, and from which it is not. */
export const LAID_FULL_RAD = (8 * Math.PI) / 180;
export const LAID_GONE_RAD = (16 * Math.PI) / 180;

const DETAIL_BITS = 10;
const DETAIL_STEPS = (1 << DETAIL_BITS) - 1;
/** A factor of one is a whole number of steps: where nothing is known, nothing changes. */
const STEPS_OF_ONE = 255;
/** The factor that the largest number stands for. */
export const LARGEST_DETAIL = DETAIL_STEPS / STEPS_OF_ONE;

export const PLACE_BITS = 12;
/** Steps across the whole picture. */
export const PLACE_STEPS = (1 << PLACE_BITS) - 1;
export const SHARE_STEPS = 255;

/** How the picture is laid on in a view, by the transforms of its person's joints, of which the first is at `at`. */
export function layingOf(
  { webcam, focalPx }: Pick<LaidPicture, "webcam" | "focalPx">,
  restJoints: Float32Array,
  transforms: Float32Array,
  at: number,
  { eye, focalPx: [viewFocalPx] }: Pick<PassCamera, "eye" | "focalPx">,
): Laying {
  const [x = 0, y = 0, z = 0] = restJoints.subarray(3 * CHEST, 3 * CHEST + 3);
  const ofChest = at + TRANSFORM * CHEST;
  const chest = transformed(transforms, ofChest, [x, y, z]);
  const toWebcam = between(chest, transformed(transforms, ofChest, webcam));
  const toEye = between(chest, eye);
  const [fromWebcamM, fromEyeM] = [Math.hypot(...toWebcam), Math.hypot(...toEye)];
  const along = toWebcam[0] * toEye[0] + toWebcam[1] * toEye[1] + toWebcam[2] * toEye[2];
  const cosine = along / Math.max(fromWebcamM * fromEyeM, 1e-9);
  const angleRad = Math.acos(Math.max(-1, Math.min(cosine, 1)));
  const scale = (focalPx * fromEyeM) / Math.max(viewFocalPx * fromWebcamM, 1e-9);
  return { strength: strengthAt(angleRad), scale };
}

/** How much of a picture is laid on so far beside its webcam. */
export function strengthAt(angleRad: number): number {
  const beside = Math.max(0, Math.min((angleRad - LAID_FULL_RAD) / (LAID_GONE_RAD - LAID_FULL_RAD), 1));
  return 1 - beside * beside * (3 - 2 * beside);
}

/** Pack red, green and blue of each factor, as a texture of 10 bits a channel has them, red lowest. */
export function packDetail(detail: Float32Array): Uint32Array<ArrayBuffer> {
  const packed = new Uint32Array(detail.length / 3);
  for (let pixel = 0, at = 0; pixel < packed.length; pixel++, at += 3) {
    packed[pixel] =
      detailSteps(detail[at]!) |
      (detailSteps(detail[at + 1]!) << DETAIL_BITS) |
      (detailSteps(detail[at + 2]!) << (2 * DETAIL_BITS));
  }
  return packed;
}

/** Pack x, y (px of the picture) and share (0 to 1) of each splat; nil for those whose centre is beside the picture. */
export function packPlaces(places: Float32Array): Uint32Array<ArrayBuffer> {
  const packed = new Uint32Array(places.length / 3);
  for (let i = 0; i < packed.length; i++) {
    const x = places[3 * i]! / PICTURE_PX;
    const y = places[3 * i + 1]! / PICTURE_PX;
    const share = Math.round(SHARE_STEPS * Math.min(places[3 * i + 2]!, 1));
    if (share <= 0 || x < 0 || y < 0 || x > 1 || y > 1) continue;
    packed[i] =
      Math.round(PLACE_STEPS * x) | (Math.round(PLACE_STEPS * y) << PLACE_BITS) | (share << (2 * PLACE_BITS));
  }
  return packed;
}

function detailSteps(factor: number): number {
  return Math.min(Math.round(STEPS_OF_ONE * factor), DETAIL_STEPS);
}

function between(from: Vec3, to: Vec3): [number, number, number] {
  return [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
}
