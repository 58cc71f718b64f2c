/**
 * Finds what face and hands do in crops of pictures, off the page's own thread: MediaPipe's Face and
 * Hand Landmarkers. Crops come in and go no further; a few numbers go out.
 */

import { FaceLandmarker, HandLandmarker, type NormalizedLandmark } from "@mediapipe/tasks-vision";
import wasmLoaderPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.js?url";
import wasmBinaryPath from "@mediapipe/tasks-vision/vision_wasm_module_internal.wasm?url";
import { asProblem, problemOf } from "../api/problem";
import { RestingFaceEstimator, faceMeasures, faceNumbers, fingerCurls, type Point } from "./expression";
import { mostCentral, type Part } from "./crops";
import { headOf, type ObservedHead } from "./head";
import type { ExpressionMessage, PartPicture } from "./expressions";

/** How a landmarker's program is made, once from each address; a second landmarker needs one of its own. */
const FACE_FILES = { wasmLoaderPath, wasmBinaryPath };
const HAND_FILES = { wasmLoaderPath: `${wasmLoaderPath}?hands`, wasmBinaryPath };
const rest = new RestingFaceEstimator();

// a dedicated worker's own scope speaks as a port does
const page = self as unknown as MessagePort;

/** The options with which a landmarker of `model` opens. Throws a Problem where the server has none. */
async function optionsOf(model: string) {
  const response = await fetch(`/v1/landmarks/${model}`);
  if (!response.ok) throw problemOf(response.status, await response.text());
  const modelAssetBuffer = new Uint8Array(await response.arrayBuffer());
  return { baseOptions: { modelAssetBuffer, delegate: "CPU" }, runningMode: "IMAGE" } as const;
}

async function openFaces(): Promise<FaceLandmarker> {
  const confidences = { minFaceDetectionConfidence: 0.3, minFacePresenceConfidence: 0.3 };
  return FaceLandmarker.createFromOptions(FACE_FILES, { ...(await optionsOf("face-model")), ...confidences });
}

async function openHands(): Promise<HandLandmarker> {
  // a blurred hand is better known roughly than not at all; a square may show both
  const looking = { numHands: 2, minHandDetectionConfidence: 0.1, minHandPresenceConfidence: 0.1 };
  return HandLandmarker.createFromOptions(HAND_FILES, { ...(await optionsOf("hand-model")), ...looking });
}

/** What opens; null where it does not: without it everything else goes on. */
async function opened<Of>(open: () => Promise<Of>): Promise<Of | null> {
  try {
    return await open();
  } catch (error) {
    console.warn(asProblem(error).detail);
    return null;
  }
}

let faces: FaceLandmarker | null = null;
let hands: HandLandmarker | null = null;

async function open(): Promise<void> {
  faces = await opened(openFaces);
  if (faces) tell({ kind: "ready", parts: ["face"] });
  hands = await opened(openHands);
  const parts: Part[] = faces ? ["face"] : [];
  if (hands) tell({ kind: "ready", parts: [...parts, "left_hand", "right_hand"] });
}
void open();

page.onmessage = ({ data: { part, square, bitmap, timeMs } }: MessageEvent<PartPicture>): void => {
  let numbers: number[] | null = null;
  let head: ObservedHead | null = null;
  try {
    if (part === "face") {
      const face = faceIn(bitmap);
      const measures = face && faceMeasures(face);
      numbers = measures && faceNumbers(measures, rest.update(measures, timeMs));
      head = face && headOf(face, square, timeMs);
    } else {
      numbers = handOf(bitmap);
    }
  } finally {
    bitmap.close();
    tell({ kind: "found", part, timeMs, numbers, head });
  }
};

function tell(answer: ExpressionMessage): void {
  page.postMessage(answer);
}

function faceIn(bitmap: ImageBitmap): Point[] | null {
  const found = faces?.detect(bitmap).faceLandmarks[0];
  return found ? pointsOf(found, bitmap) : null;
}

function handOf(bitmap: ImageBitmap): number[] | null {
  const { landmarks, worldLandmarks } = hands?.detect(bitmap) ?? { landmarks: [], worldLandmarks: [] };
  const found = worldLandmarks[mostCentral(landmarks)];
  return found ? fingerCurls(found.map(({ x, y, z }): Point => [x, y, z])) : null;
}

function pointsOf(found: readonly NormalizedLandmark[], { width, height }: ImageBitmap): Point[] {
  return found.map(({ x, y, z }): Point => [x * width, y * height, z * width]);
}
