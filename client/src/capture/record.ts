/** A clip from the webcam: one slow turn, filmed by the browser. */

import { chosenDevices } from "./devices";
import { Problem } from "../api/problem";

/** Long enough for one slow turn, short enough to hold still. */
export const TURN_S = 15;
export const COUNTDOWN_S = 5;

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

/** What to call out `second` seconds into the turn. */
export function turnInstruction(second: number): string {
  const share = second / TURN_S;
  if (share < 0.1) return "Face the camera";
  if (share < 0.3) return "Turn slowly to your left";
  if (share < 0.45) return "Keep turning: now your back";
  if (share < 0.65) return "Keep turning, nice and slow";
  if (share < 0.85) return "Almost done";
  return "Face the camera again";
}

/** Records one turn, or until `signal` aborts (then it rejects). */
export function recordTurn(stream: MediaStream, onSecond: (second: number) => void, signal: AbortSignal): Promise<RecordedClip> {
  return record(stream, TURN_S, onSecond, signal);
}

/** Records `stream` for so many seconds; rejects where the camera goes before, or `signal` aborts. */
export function record(
  stream: MediaStream,
  seconds: number,
  onSecond: (second: number) => void,
  signal: AbortSignal,
): Promise<RecordedClip> {
  const [mimeType, fileName] = TYPES.find(([type]) => MediaRecorder.isTypeSupported(type)) ?? TYPES[3];
  const recorder = new MediaRecorder(stream, { mimeType, videoBitsPerSecond: BITS_PER_SECOND });
  const parts: Blob[] = [];
  return new Promise((resolve, reject) => {
    const startMs = performance.now();
    let whole = false;
    const tick = setInterval(() => {
      const second = (performance.now() - startMs) / 1000;
      whole = second >= seconds;
      onSecond(Math.min(second, seconds));
      if (whole && recorder.state === "recording") recorder.stop();
    }, 100);
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onerror = () => reject(cameraProblem("NotReadableError"));
    recorder.onstop = () => {
      clearInterval(tick);
      if (signal.aborted) reject(signal.reason as unknown);
      else if (!whole) reject(cameraProblem("NotReadableError"));
      else resolve({ blob: new Blob(parts, { type: mimeType.split(";")[0] ?? mimeType }), fileName });
    };
    signal.addEventListener("abort", () => recorder.state === "recording" && recorder.stop(), {
      once: true,
    });
    recorder.start(1000);
  });
}

export function closeCamera(stream: MediaStream | null): void {
  stream?.getTracks().forEach((track) => track.stop());
}
