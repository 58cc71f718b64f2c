/** The webcam, and clips of it, filmed by the browser. */

import { chosenDevices } from "./devices";
import { Problem } from "../api/problem";

const TYPES = [
  ["video/mp4;codecs=avc1.42E01E", "webcam.mp4"],
  ["video/webm;codecs=vp9", "webcam.webm"],
  ["video/webm;codecs=vp8", "webcam.webm"],
  ["video/webm", "webcam.webm"],
] as const;
export interface RecordedClip {
  blob: Blob;
  fileName: string;
}

/** An open camera stopped. */
export const CAMERA_GONE = new Problem(
  "The camera was disconnected",
  "Reconnect it, or close the program that uses it, then try again.",
);

const BITS_PER_SECOND = 6_000_000;

/** Opens the camera; a refusal or a missing camera becomes a Problem that says what to do. */
export async function openCamera(size = { width: 1280, height: 720 }): Promise<MediaStream> {
  const devices = globalThis.navigator?.mediaDevices;
  if (!devices?.getUserMedia) {
    throw new Problem(
      "The camera can't be used on this page",
      "Browsers allow it only on secure addresses (https or localhost); upload a clip instead.",
    );
  }
  const { camera } = chosenDevices();
  const video = {
    ...(camera === "" ? { facingMode: "user" } : { deviceId: { ideal: camera } }),
    width: { ideal: size.width },
    height: { ideal: size.height },
    frameRate: { ideal: 30 },
  };
  try {
    return await devices.getUserMedia({ video, audio: false });
  } catch (error) {
    throw cameraProblem(error instanceof Error ? error.name : "");
  }
}

export function cameraProblem(errorName: string): Problem {
  switch (errorName) {
    case "NotAllowedError":
    case "SecurityError":
      return new Problem(
        "The camera is blocked",
        "Allow it in the address bar of your browser, then try again; or upload a clip instead.",
      );
    case "NotFoundError":
    case "OverconstrainedError":
      return new Problem("No camera found", "Plug one in and try again, or upload a clip instead.");
    case "NotReadableError":
    case "AbortError":
      return new Problem(
        "The camera is busy",
        "Another program may be using it; close that one, then try again.",
      );
    default:
      return new Problem("The camera did not start", "Try again, or upload a clip instead.");
  }
}

/** A recording that goes on until it is stopped. */
export interface Recording {
  /** Rejects with a Problem where the browser can't go on. */
  readonly ended: Promise<RecordedClip>;
  stop(): Promise<RecordedClip>;
}

export function startRecording(stream: MediaStream): Recording {
  const [mimeType, fileName] = TYPES.find(([type]) => MediaRecorder.isTypeSupported(type)) ?? TYPES[3];
  const recorder = new MediaRecorder(stream, { mimeType, videoBitsPerSecond: BITS_PER_SECOND });
  const parts: Blob[] = [];
  const ended = new Promise<RecordedClip>((resolve, reject) => {
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onerror = () => reject(cameraProblem("NotReadableError"));
    recorder.onstop = () => resolve({ blob: new Blob(parts, { type: mimeType.split(";")[0] ?? mimeType }), fileName });
  });
  recorder.start(1000);
  const stop = (): Promise<RecordedClip> => {
    if (recorder.state === "recording") recorder.stop();
    return ended;
  };
  return { ended, stop };
}

/** Records `stream` for so many seconds; rejects where the camera goes before, or `signal` aborts. */
export async function record(
  stream: MediaStream,
  seconds: number,
  onSecond: (second: number) => void,
  signal: AbortSignal,
): Promise<RecordedClip> {
  const recording = startRecording(stream);
  const startMs = performance.now();
  let whole = false;
  const tick = setInterval(() => {
    const second = (performance.now() - startMs) / 1000;
    whole = second >= seconds;
    onSecond(Math.min(second, seconds));
    if (whole) void recording.stop().catch(() => undefined);
  }, 100);
  signal.addEventListener("abort", () => void recording.stop().catch(() => undefined), { once: true });
  try {
    const clip = await recording.ended;
    signal.throwIfAborted();
    if (!whole) throw cameraProblem("NotReadableError");
    return clip;
  } finally {
    clearInterval(tick);
  }
}

export function closeCamera(stream: MediaStream | null): void {
  stream?.getTracks().forEach((track) => track.stop());
}
