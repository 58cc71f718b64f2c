/** Which camera and microphone this browser uses, and whether one comes in heard; remembered. */

import { Problem } from "../api/problem";

export interface DeviceChoice {
  /** Ids as the browser gives them; empty: whichever it takes. */
  camera: string;
  microphone: string;
  /** Join with the microphone on. */
  joinUnmuted: boolean;
}

type Store = Pick<Storage, "getItem" | "setItem">;

const KEY = "metanerf.devices";
const DEFAULTS: DeviceChoice = { camera: "", microphone: "", joinUnmuted: false };

export function chosenDevices(store: Store | undefined = globalThis.localStorage): DeviceChoice {
  try {
    return { ...DEFAULTS, ...(JSON.parse(store?.getItem(KEY) ?? "{}") as Partial<DeviceChoice>) };
  } catch {
    return DEFAULTS; // what another release wrote
  }
}

export function storeDevices(change: Partial<DeviceChoice>, store: Store | undefined = globalThis.localStorage): void {
  store?.setItem(KEY, JSON.stringify({ ...chosenDevices(store), ...change }));
}

/** The microphone of one's choice, or another where that one is gone. */
export function microphoneConstraints(): MediaTrackConstraints {
  const { microphone } = chosenDevices();
  const clean = { echoCancellation: true, noiseSuppression: true, autoGainControl: true };
  return microphone === "" ? clean : { ...clean, deviceId: { ideal: microphone } };
}

/** Open the microphone. Throws a Problem that says what to do. */
export async function openMicrophone(): Promise<MediaStream> {
  const devices = globalThis.navigator?.mediaDevices;
  if (!devices?.getUserMedia) throw microphoneProblem("SecurityError");
  try {
    return await devices.getUserMedia({ audio: microphoneConstraints() });
  } catch (error) {
    throw microphoneProblem(error instanceof Error ? error.name : "");
  }
}

export function microphoneProblem(errorName: string): Problem {
  switch (errorName) {
    case "NotAllowedError":
    case "SecurityError":
      return new Problem(
        "The microphone is blocked",
        "Allow it in the address bar of your browser, then try again. You can join without one, to listen and write.",
      );
    case "NotFoundError":
    case "OverconstrainedError":
      return new Problem("No microphone found", "Plug one in and try again. You can join without one, to listen and write.");
    case "NotReadableError":
    case "AbortError":
      return new Problem("The microphone is busy", "Another program may be using it; close that one, then try again.");
    default:
      return new Problem("The microphone did not start", "Try again. You can join without one, to listen and write.");
  }
}

/** How loud samples of -1 to 1 are, from 0 (silence, -60 dB) to 1 (full scale). */
export function loudness(samples: Float32Array): number {
  let sum = 0;
  for (const sample of samples) sum += sample * sample;
  const decibels = 10 * Math.log10(sum / Math.max(samples.length, 1) + 1e-12);
  return Math.min(1, Math.max(0, 1 + decibels / 60));
}
