/**
 * Finds what face and hands do in crops of pictures, off the page's own thread: MediaPipe's Face and
 * Hand Landmarkers. Crops come in and go no further; a few numbers go out.
 */

import { FaceLandmarker, HandLandmarker, type NormalizedLandmark } from "@mediapipe/tasks-vision";
import wasmLoaderPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.js?url";
import wasmBinaryPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.wasm?url";
import { RestFinder, faceMeasures, faceNumbers, handCurl, type Point } from "./expression";
import type { Part } from "./crops";
import type { PartAnswer, PartPicture } from "./expressions";

const FILES = { wasmLoaderPath, wasmBinaryPath };
const rest = new RestFinder();
let faces: FaceLandmarker | null = null;
let hands: HandLandmarker | null = null;

// a dedicated worker's own scope speaks as a port does
const page = self as unknown as MessagePort;

/** The options with which a landmarker of `model` opens; null where the server has none. */
async function optionsOf(model: string) {
  const response = await fetch(`/v1/landmarks/${model}`);
  if (!response.ok) return null;
  const modelAssetBuffer = new Uint8Array(await response.arrayBuffer());
  return { baseOptions: { modelAssetBuffer, delegate: "CPU" }, runningMode: "IMAGE" } as const;
}

async function open(): Promise<Part[]> {
  const face = await optionsOf("face-model");
  if (face) {
    const confidences = { minFaceDetectionConfidence: 0.3, minFacePresenceConfidence: 0.3 };
    faces = await FaceLandmarker.createFromOptions(FILES, { ...face, ...confidences, numFaces: 1 });
  }
  const hand = await optionsOf("hand-model");
  if (hand) hands = await HandLandmarker.createFromOptions(FILES, { ...hand, numHands: 1 });
  return [...(faces ? (["face"] as const) : []), ...(hands ? (["left_hand", "right_hand"] as const) : [])];
}

open().then(
  (parts) => tell({ kind: "ready", parts }),
  // without them everything else goes on
  () => tell({ kind: "ready", parts: [] }),
);

page.onmessage = ({ data: { part, bitmap, timeMs } }: MessageEvent<PartPicture>): void => {
  let numbers: number[] | null = null;
  try {
    numbers = part === "face" ? faceOf(bitmap, timeMs) : handOf(bitmap);
  } finally {
    bitmap.close();
    tell({ kind: "found", part, timeMs, numbers });
  }
};

function tell(answer: PartAnswer): void {
  page.postMessage(answer);
}

function faceOf(bitmap: ImageBitmap, timeMs: number): number[] | null {
  const found = faces?.detect(bitmap).faceLandmarks[0];
  const measures = found ? faceMeasures(pointsOf(found, bitmap)) : null;
  return measures && faceNumbers(measures, rest.learn(measures, timeMs));
}

function handOf(bitmap: ImageBitmap): number[] | null {
  const found = hands?.detect(bitmap).worldLandmarks[0];
  return found ? [handCurl(found.map(({ x, y, z }): Point => [x, y, z]))] : null;
}

function pointsOf(found: readonly NormalizedLandmark[], { width, height }: ImageBitmap): Point[] {
  return found.map(({ x, y, z }): Point => [x * width, y * height, z * width]);
}
