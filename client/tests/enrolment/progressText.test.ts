import { describe, expect, it } from "vitest";
import type { EnrolState } from "../../src/enrolment/enrol";
import { progressText } from "../../src/enrolment/progressText";
import { UPLOAD_WORDS } from "../../src/enrolment/uploadWords";
import { job } from "../fakes";

function words(part: Partial<EnrolState>): string {
  return progressText({
    step: "capture",
    status: "working",
    fraction: 0.404,
    message: "",
    name: "Ada",
    sequence: null,
    job: job(),
    modelId: null,
    problem: null,
    ...part,
  });
}

describe("progressText", () => {
  it.each([
    ["no steps and losses of a training", { step: "train", message: "learning the looks (step 5, loss 0.1)" }, "Training your model · 40 %"],
    ["none of its first step either", { step: "train", fraction: 0, message: "step 1, loss 0.0940" }, "Training your model · 0 %"],
    ["what a training waits for", { step: "train", fraction: 0, message: "starting" }, "Preparing · 0 %"],
    ["that a training looks for a smaller model", { step: "train", message: "finding how few splats do (7,071 of 10,000 tried)" }, "Making your model as small as it can be · 40 %"],
    ["the stages of a capture to whom they are about", { message: "finding the person" }, "Detecting you · 40 %"],
    ["nothing of a likeness twice", { message: "a first likeness is ready", modelId: "early" }, "Detecting you more closely · 40 %"],
    ["a stage that it has no words for as it came", { message: "drying the paint" }, "Drying the paint · 40 %"],
    ["how far the sending is", { step: "upload", job: null }, "40 %"],
    ["what the sending waits for", { step: "upload", job: null, message: UPLOAD_WORDS.waiting }, "Interrupted, trying again · 40 %"],
    ["how far it came when stopped", { step: "train", status: "stopped", message: "cancelled" }, "40 %"],
    ["a queue", { fraction: 0, job: job({ state: "queued" }) }, "Waiting for the server · 0 %"],
    ["an interruption", { step: "train", job: job({ state: "queued" }) }, "Interrupted, resuming soon · 40 %"],
    ["nothing where nothing was said", { job: null }, "40 %"],
  ] as [string, Partial<EnrolState>, string][])("tells %s", (_, part, expected) => {
    expect(words(part)).toBe(expected);
  });
});
