/** A body in a picture of a webcam, as landmarks. */

export const LANDMARK_COUNT = 33;

/** One person in one picture, as MediaPipe's Pose Landmarker finds them. */
export interface Landmarks {
  /** px, of the picture. */
  width: number;
  height: number;
  /** x, y of each landmark, as shares of the picture's width and height. */
  xy: Float32Array;
  /** x, y, z of each, m: origin between the hips, x right, y down, z away from the camera. */
  world: Float32Array;
  /** Of each, 0 (hidden or outside) to 1 (seen). */
  visibility: Float32Array;
}
