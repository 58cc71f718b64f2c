/** Looks at a camera's pictures: where somebody is in them, and how bright and sharp they are there. */

import { SAMPLE_PX, pictureQuality, type PictureQuality } from "../capture/pictureQuality";
import { cropOf, upperBodySquare } from "../landmarks/crops";
import { LandmarkDetector } from "../landmarks/detector";
import { eachFrame } from "../landmarks/frames";
import type { Landmarks } from "../landmarks/landmarks";
import type { Square } from "../look/pictureCode";
import { isNearFace, type Observation } from "./steps";

export interface WatchHooks {
  onObservation(observation: Observation): void;
  onFailed(reason: string): void;
}

/** The detector needs no more. */
const WIDTH_PX = 640;

/** Watch what `video` plays until the returned function is called. */
export function watch(video: HTMLVideoElement, { onObservation, onFailed }: WatchHooks): () => void {
  const canvas = new OffscreenCanvas(SAMPLE_PX, SAMPLE_PX);
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  const sample = (x: number, y: number, width: number, height: number): PictureQuality => {
    pen?.drawImage(video, x, y, width, height, 0, 0, SAMPLE_PX, SAMPLE_PX);
    return pictureQuality(pen?.getImageData(0, 0, SAMPLE_PX, SAMPLE_PX).data ?? new Uint8ClampedArray());
  };
  const qualityOf = (seen: Landmarks | null): PictureQuality => {
    const square = seen && squareOf(seen);
    if (!square) return sample(0, 0, video.videoWidth, video.videoHeight);
    const scale = video.videoWidth / seen.width;
    return sample(square.x * scale, square.y * scale, square.side * scale, square.side * scale);
  };
  const grab = (): Promise<ImageBitmap> => createImageBitmap(video, { resizeWidth: Math.min(WIDTH_PX, video.videoWidth) });
  const detector = new LandmarkDetector(grab, {
    onFound: (seen, timeMs) => onObservation({ timeMs, seen, quality: qualityOf(seen) }),
    onFailed,
  });
  const endFrames = eachFrame(video, (timeMs) => detector.offer(timeMs));
  return () => {
    endFrames();
    detector.close();
  };
}

/** Of a face nearby the face; of whoever is farther away, or turned away, more, for a few pixels of hair are never sharp. */
function squareOf(seen: Landmarks): Square | null {
  return isNearFace(seen) ? cropOf("face", seen) : upperBodySquare(seen);
}
