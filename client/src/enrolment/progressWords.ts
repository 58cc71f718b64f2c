/** What the server is doing, in words for the person whom it is doing it with. */

import type { EnrolState } from "./enrol";

type Doing = Pick<EnrolState, "step" | "status" | "fraction" | "message" | "job">;

const WAITING = "Waiting for the server to be free";
const LEARNING = "Learning what you look like";
/** The server's words for a stage, and ours: it speaks of "the person", we speak to them. */
const WORDS: Readonly<Record<string, string>> = {
  "waiting for a worker": WAITING,
  starting: "Getting ready",
  "reading the clip": "Looking through your clip",
  "finding the person": "Finding you",
  "cutting out the person": "Cutting you out of the background",
  "fitting the body": "Following how you move",
  "writing the sequence": "Putting your pictures away",
  storing: "Putting your pictures away",
};

/** One line of progress: "Finding you · 40 %". Of the sending there is no more to say than how far. */
export function progressInWords({ step, status, fraction, message, job }: Doing): string {
  const percent = `${Math.round(100 * fraction)} %`;
  if (status !== "working" || step === "upload") return percent;
  return [doing(step, job?.state === "queued", fraction, message), percent].filter(Boolean).join(" · ");
}

function doing(step: EnrolState["step"], queued: boolean, fraction: number, message: string): string {
  if (queued) return fraction > 0 ? "Interrupted; going on in a moment" : WAITING;
  // how a training counts its steps means nothing to people
  if (step === "train" && fraction > 0) return LEARNING;
  return WORDS[message] ?? message.charAt(0).toUpperCase() + message.slice(1);
}
