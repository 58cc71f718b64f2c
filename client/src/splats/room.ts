/** The room round the people as the server draws it: its colours, and shadows where people stand. */

import type { Viewpoint as DefaultViewpoint, Light } from "../api/types";
import type { Vec3 } from "../viewpoint/geometry";
import type { PassCamera } from "./camera";
import { NEAR_M } from "./sort";
import { transformedJoint, TRANSFORM, type Skeleton } from "./skeleton";

/** sRGB of `scene.environment.Environment`. */
export const STUDIO = {
  horizon: [0.86, 0.88, 0.91],
  zenith: [0.55, 0.62, 0.72],
  floor: [0.62, 0.6, 0.58],
  shadowStrength: 0.45,
} as const;

/** An environment: its panorama and its lighting; both null: the studio, with the light of the clips. */
export interface LoadedEnvironment {
  /** Equirectangular, its middle towards +x. */
  panorama: ImageBitmap | null;
  light: Light | null;
}

/** A shared screen in the room: upright, so far behind whoever sits farthest away. */
const SCREEN = { heightM: 1.72, behindM: 1.9, widest: 2.6, highest: 1.5 } as const;

/** Where the middle of a shared screen is, and which way it faces. */
export interface ScreenPlace {
  centre: Vec3;
  azimuthRad: number;
}

/** Behind everybody whom one sees from `view`, facing that way. */
export function screenPlace({ target: [x, , z], azimuth_rad: azimuthRad, depth_m: depthM }: DefaultViewpoint): ScreenPlace {
  const behindM = SCREEN.behindM + depthM;
  return { centre: [x - behindM * Math.sin(azimuthRad), SCREEN.heightM, z - behindM * Math.cos(azimuthRad)], azimuthRad };
}

/** Half the width and height (m) of a screen of so many pixels. */
export function screenHalfSize(width: number, height: number): readonly [number, number] {
  const scale = Math.min(SCREEN.widest / Math.max(width, 1), SCREEN.highest / Math.max(height, 1));
  return [0.5 * scale * width, 0.5 * scale * height];
}

/** The panorama of an environment, its bytes as they are. Throws where it is none. */
export function decodePanorama(data: Blob): Promise<ImageBitmap> {
  return createImageBitmap(data, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
}

const ANKLES = [7, 8];
const SHADOW_RADIUS_M = 0.22;
/** Height of an ankle above the floor at which its shadow has vanished. */
const FOOT_CLEARANCE_M = 0.35;

/** A shadow ends at so many squared radii from its middle. */
export const SHADOW_SPREAD = 12;

/** x, z, radius (m) and strength of a soft shadow on the floor. */
export type Shadow = readonly [number, number, number, number];

/** The shadows under somebody whose transforms begin at `at`. */
export function contactShadows(bones: Skeleton, transforms: Float32Array, at: number): Shadow[] {
  return ANKLES.map((ankle) => {
    const [x, y, z] = transformedJoint(transforms, at + TRANSFORM * ankle, bones.restJoints, ankle);
    const lifted = Math.max(0, y - (bones.restJoints[3 * ankle + 1] ?? 0)) / FOOT_CLEARANCE_M;
    const strength = STUDIO.shadowStrength * Math.max(0, 1 - lifted);
    return [x, z, SHADOW_RADIUS_M * (1 + lifted), strength];
  });
}

/** Left, top, right and bottom (px) of the part of the picture in which shadows may be seen; null: none are. */
export function shadowBounds(camera: PassCamera, shadows: readonly Shadow[]): readonly [number, number, number, number] | null {
  const { worldToCamera: m, focalPx, centrePx, width, height } = camera;
  let [left, top, right, bottom] = [width, height, 0, 0];
  for (const [x, z, radius, strength] of shadows) {
    if (strength <= 0) continue;
    const reach = Math.sqrt(SHADOW_SPREAD) * radius;
    for (const [px, pz] of [[x - reach, z - reach], [x + reach, z - reach], [x - reach, z + reach], [x + reach, z + reach]] as const) {
      const row = (r: number): number => (m[4 * r] ?? 0) * px + (m[4 * r + 2] ?? 0) * pz + (m[4 * r + 3] ?? 0);
      const depth = row(2);
      if (depth <= NEAR_M) return [0, 0, width, height]; // some of it is beside or behind the camera
      const [u, v] = [centrePx[0] + (focalPx[0] * row(0)) / depth, centrePx[1] + (focalPx[1] * row(1)) / depth];
      [left, right] = [Math.min(left, u), Math.max(right, u)];
      [top, bottom] = [Math.min(top, v), Math.max(bottom, v)];
    }
  }
  const box = [Math.max(0, Math.floor(left)), Math.max(0, Math.floor(top)), Math.min(width, Math.ceil(right)), Math.min(height, Math.ceil(bottom))] as const;
  return box[0] < box[2] && box[1] < box[3] ? box : null;
}
