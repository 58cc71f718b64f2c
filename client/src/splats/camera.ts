/** Cameras that people and room are drawn from, and where their pictures go. */

import { rotationMatrix } from "../viewpoint/geometry";
import type { CameraPose } from "../viewpoint/viewpoint";

/** A pinhole camera in the room, OpenCV axes. */
export interface PassCamera {
  /** R and t of world -> camera: three rows of four numbers. */
  worldToCamera: Float32Array;
  eye: readonly [number, number, number];
  /** Across and down, px. */
  focalPx: readonly [number, number];
  /** Principal point, px from the upper left corner. */
  centrePx: readonly [number, number];
  width: number;
  height: number;
}

export function passCamera(pose: CameraPose, fovYRad: number, width: number, height: number): PassCamera {
  const cameraToWorld = rotationMatrix(pose.wxyz);
  const worldToCamera = new Float32Array(12);
  for (let r = 0; r < 3; r++) {
    for (let c = 0; c < 3; c++) {
      const value = cameraToWorld[3 * c + r] ?? 0;
      worldToCamera[4 * r + c] = value;
      worldToCamera[4 * r + 3] = (worldToCamera[4 * r + 3] ?? 0) - value * (pose.position[c] ?? 0);
    }
  }
  const [x, y, z] = pose.position;
  const focal = (0.5 * height) / Math.tan(0.5 * fovYRad);
  const centrePx = [0.5 * width, 0.5 * height] as const;
  return { worldToCamera, eye: [x, y, z], focalPx: [focal, focal], centrePx, width, height };
}

/** A part of a framebuffer as large as the camera's picture; null: the canvas itself. */
export interface Eye {
  camera: PassCamera;
  framebuffer: WebGLFramebuffer | null;
  /** Lower left corner, px. */
  x: number;
  y: number;
}
