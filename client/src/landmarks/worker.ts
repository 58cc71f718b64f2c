/**
 * Finds landmarks in pictures, off the page's own thread: MediaPipe's Pose Landmarker.
 *
 * Pictures come in and go no further; landmarks go out. The processor is enough (`metanerf
 * bench meeting` tells its time), and leaves the graphics card to whoever draws the room.
 */

import { PoseLandmarker, type PoseLandmarkerResult } from "@mediapipe/tasks-vision";
import wasmLoaderPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.js?url";
import wasmBinaryPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.wasm?url";
import { asProblem, problemOf } from "../api/problem";
import type { DetectorMessage, Picture } from "./detector";
import { LANDMARK_COUNT, type Landmarks } from "./packet";

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

page.onmessage = async ({ data }: MessageEvent<Picture>): Promise<void> => {
  const { bitmap, timeMs } = data;
  const { width, height } = bitmap;
  try {
    startMs ??= timeMs;
    const found = (await landmarker).detectForVideo(bitmap, timeMs - startMs);
    tell({ kind: "found", timeMs, seen: person(found, width, height) });
  } catch (error) {
    tell({ kind: "failed", reason: asProblem(error).detail });
  } finally {
    bitmap.close();
  }
};

function tell(answer: DetectorMessage): void {
  page.postMessage(answer);
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
