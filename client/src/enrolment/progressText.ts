/** What the server is doing, in words for the person whom it is doing it with. */

import type { EnrolState } from "./enrol";

type Doing = Pick<EnrolState, "step" | "status" | "fraction" | "message" | "job">;

const WAITING = "Waiting for the server";
const LEARNING = "Training your model";
const SIZING = "finding how few splats do";
const SMALLER = "Making your model as small as it can be";
/** The server's words for a stage, and ours: it speaks of "the person", we speak to them. */
const WORDS: Readonly<Record<string, string>> = {
  "waiting for a worker": WAITING,
  starting: "Preparing",
  "reading the clip": "Reading your clip",
  "finding the person": "Detecting you",
  "cutting out the person": "Separating you from the background",
  "fitting the body": "Estimating your movements",
  // said in full beside it
  "a first likeness is ready": "Detecting you more closely",
  "writing the sequence": "Storing the frames",
  storing: "Storing the frames",
};

/** One line of progress: "Detecting you · 40 %". */
export function progressText({ step, status, fraction, message, job }: Doing): string {
  const percent = `${Math.round(100 * fraction)} %`;
  if (status !== "working") return percent;
  return [activityText(step, job?.state === "queued", fraction, message), percent].filter(Boolean).join(" · ");
}

function activityText(step: EnrolState["step"], queued: boolean, fraction: number, message: string): string {
  if (step === "upload") return message;
  if (queued) return fraction > 0 ? "Interrupted, resuming soon" : WAITING;
  // how a training counts its steps means nothing to people
  if (step === "train") return (fraction === 0 && WORDS[message]) || (message.startsWith(SIZING) ? SMALLER : LEARNING);
  return WORDS[message] ?? message.charAt(0).toUpperCase() + message.slice(1);
}
