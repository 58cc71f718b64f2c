/**
 * Finds landmarks in pictures, off the page's own thread: MediaPipe's Pose Landmarker.
 *
 * Pictures come in and go no further; landmarks go out, and for live look the person cut out. The processor is enough (`metanerf
 * bench meeting` tells its time), and leaves the graphics card to whoever draws the room.
 */

import { PoseLandmarker, type PoseLandmarkerResult } from "@mediapipe/tasks-vision";
import wasmLoaderPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.js?url";
import wasmBinaryPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.wasm?url";
import { asProblem, problemOf } from "../api/problem";
import { CutOut } from "../look/cutOut";
import type { DetectorMessage, Picture } from "./detector";
import { LANDMARK_COUNT, type Landmarks } from "./landmarks";

const MODEL = "/v1/landmarks/model";

// a dedicated worker's own scope speaks as a port does
const page = self as unknown as MessagePort;

const landmarker = (async (): Promise<PoseLandmarker> => {
  const response = await fetch(MODEL);
  if (!response.ok) throw problemOf(response.status, await response.text());
  return PoseLandmarker.createFromOptions(
    { wasmLoaderPath, wasmBinaryPath },
    {
      baseOptions: { modelAssetBuffer: new Uint8Array(await response.arrayBuffer()), delegate: "CPU" },
      runningMode: "VIDEO",
      numPoses: 1,
    },
  );
})();
landmarker.then(
  () => tell({ kind: "ready" }),
  (error: unknown) => tell({ kind: "failed", reason: asProblem(error).detail }),
);

let startMs: number | null = null;
let cutOut: CutOut | null = null;

page.onmessage = async ({ data }: MessageEvent<Picture>): Promise<void> => {
  const { bitmap, timeMs, look } = data;
  const { width, height } = bitmap;
  try {
    startMs ??= timeMs;
    const finder = await landmarker;
    if (look !== (cutOut !== null)) {
      await finder.setOptions({ outputSegmentationMasks: look });
      cutOut = look ? new CutOut() : null;
    }
    const found = finder.detectForVideo(bitmap, timeMs - startMs);
    const seen = person(found, width, height);
    tell({ kind: "found", timeMs, seen, look: seen && cutOutOf(found, bitmap, seen, timeMs) });
    found.close();
  } catch (error) {
    tell({ kind: "failed", reason: asProblem(error).detail });
  } finally {
    bitmap.close();
  }
};

function tell(answer: DetectorMessage): void {
  const moved = answer.kind === "found" && answer.look ? [answer.look] : [];
  page.postMessage(answer, moved);
}

function cutOutOf(found: PoseLandmarkerResult, bitmap: ImageBitmap, seen: Landmarks, timeMs: number): ImageBitmap | null {
  const mask = found.segmentationMasks?.[0];
  if (!cutOut || !mask) return null;
  const { width, height } = mask;
  return cutOut.draw(bitmap, { width, height, values: mask.getAsFloat32Array() }, seen, timeMs);
}

function person(found: PoseLandmarkerResult, width: number, height: number): Landmarks | null {
  const flat = found.landmarks[0];
  const world = found.worldLandmarks[0];
  if (flat?.length !== LANDMARK_COUNT || world?.length !== LANDMARK_COUNT) return null;
  return {
    width,
    height,
    xy: Float32Array.from(flat.flatMap(({ x, y }) => [x, y])),
    world: Float32Array.from(world.flatMap(({ x, y, z }) => [x, y, z])),
    visibility: Float32Array.from(flat, ({ visibility }) => visibility),
  };
}
