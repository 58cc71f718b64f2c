/** From clip to model: what is being done, how far it is, and what can be seen of it already. */

import type { Api } from "../api/api";
import type { Clip, EnrolState, Enrolment, Step } from "../enrolment/enrol";
import { asProblem } from "../api/problem";
import { clipProblem } from "../enrolment/plainWords";
import { progressText } from "../enrolment/progressText";
import { modelLines } from "../enrolment/modelReport";
import { advice, qualityLines, type QualityLine } from "../enrolment/quality";
import type { Sequence } from "../api/types";
import { announce, h, withoutEmpty, usesTouch } from "./dom";
import { icon } from "./icons";
import { previewPane } from "./previewPane";
import { button, notice, type View } from "./shell";

const STEPS: readonly (readonly [Step, string, string])[] = [
  ["upload", "Upload the clip", "Uploading your clip"],
  ["capture", "Detect you in the clip", "Detecting you in the clip"],
  ["train", "Train your model", "Training your model"],
];

const MEET_EARLY = "This is a first likeness, which becomes sharper. You can join the meeting already.";

interface ProgressHooks {
  onMeet(modelId: string): void;
  onAgain(): void;
}

export interface ProgressView extends View {
  show(state: EnrolState): void;
  /** Whether work is under way that a stray press must not leave. */
  busy(): boolean;
}

export function progressView(
  api: Api,
  enrolment: Enrolment,
  clip: Clip | null,
  hooks: ProgressHooks,
): ProgressView {
  const pane = previewPane(api, clip);
  const title = h("h1", { tabIndex: -1 });
  const steps = h("ol", { className: "steps" });
  const bar = h("div", { className: "bar" }, h("div", { className: "bar-fill" }));
  bar.dataset["testid"] = "progress";
  bar.setAttribute("role", "progressbar");
  bar.setAttribute("aria-valuemin", "0");
  bar.setAttribute("aria-valuemax", "100");
  const message = h("p", { className: "secondary message" });
  const report = h("div", { className: "quality", testId: "quality", hidden: true });
  const ofModel = h("div", { className: "quality", testId: "model-report", hidden: true });
  const ways = h("div", { className: "actions" });
  const trouble = h("div", {});
  let waysShown = "";

  const cancel = button("Cancel", () => void stop(), { testId: "cancel" });
  const resume = button("Resume", () => void enrolment.resume(), {
    look: "primary",
    icon: "reset",
    testId: "resume",
  });
  const again = button("Start again", hooks.onAgain);
  const retry = button("Try again", hooks.onAgain, { look: "primary" });
  const reconnect = button("Try again", () => void enrolment.reconnect(), { look: "primary" });
  const meet = button(
    "Meet",
    () => {
      const { modelId } = enrolment.state;
      if (modelId) hooks.onMeet(modelId);
    },
    { look: "primary", large: true, icon: "arrow", testId: "meet" },
  );

  const stop = (): Promise<void> =>
    enrolment.cancel().catch((error: unknown) => trouble.replaceChildren(notice(asProblem(error))));

  const show = (state: EnrolState): void => {
    title.textContent = titleOf(state);
    steps.replaceChildren(...STEPS.map((step) => stepLine(step, state)));
    const percent = Math.round(100 * state.fraction);
    (bar.firstElementChild as HTMLElement).style.setProperty("--share", String(state.fraction));
    bar.setAttribute("aria-valuenow", String(percent));
    bar.setAttribute("aria-label", title.textContent);
    bar.classList.toggle("resting", state.status !== "working");
    bar.hidden = state.status === "ready";
    message.textContent = messageOf(state);
    if (state.sequence) showQuality(report, state.sequence);
    if (state.status === "ready" && state.modelId) void showModel(state.modelId);
    pane.show(state);
    trouble.replaceChildren(...(state.problem ? [notice(clipProblem(state.problem))] : []));
    const actions = actionsFor(state);
    // replacing buttons would take the focus from whoever is about to press one
    if (actions.key !== waysShown) {
      waysShown = actions.key;
      ways.replaceChildren(...withoutEmpty(actions.buttons));
      announce(title.textContent);
      if (state.problem) ways.scrollIntoView({ block: "nearest" });
    }
  };

  /** It is an extra: without an answer nothing is missed. */
  const showModel = async (modelId: string): Promise<void> => {
    if (ofModel.dataset["of"] === modelId) return;
    ofModel.dataset["of"] = modelId;
    const lines = await api.model(modelId).then(modelLines, () => []);
    ofModel.hidden = lines.length === 0;
    ofModel.replaceChildren(h("h2", {}, "Your model"), lineList(lines));
  };

  const actionsFor = (state: EnrolState): { key: string; buttons: HTMLElement[] } => {
    cancel.disabled = state.status === "stopping";
    const met = state.modelId ? [meet] : [];
    switch (state.status) {
      case "working":
      case "stopping":
        return { key: `work ${met.length}`, buttons: [...met, cancel] };
      case "ready":
        return { key: "ready", buttons: [meet] };
      case "stopped":
      case "failed":
        if (enrolment.canReconnect) return { key: "reconnect", buttons: [reconnect, again] };
        return enrolment.canResume
          ? { key: `resume ${met.length}`, buttons: [...met, resume, again] }
          : { key: "again", buttons: [retry] };
    }
  };

  const element = h(
    "main",
    { className: "progress" },
    pane.element,
    h("section", { className: "progress-text" }, title, steps, bar, message, trouble, ways, report, ofModel),
  );
  const busy = (): boolean => ["working", "stopping"].includes(enrolment.state.status);
  return { element, show, busy, close: () => pane.close() };
}

function titleOf({ step, status, name }: EnrolState): string {
  const present = STEPS.find(([key]) => key === step)?.[2] ?? "";
  switch (status) {
    case "working":
      return present;
    case "stopping":
      return "Stopping";
    case "stopped":
      return "Stopped";
    case "failed":
      return "Something went wrong";
    case "ready":
      return name ? `${name}, you are ready` : "You are ready";
  }
}

function messageOf(state: EnrolState): string {
  if (state.status === "ready") {
    return usesTouch()
      ? "In the meeting, turn the view with one finger to see yourself from every side."
      : "In the meeting, drag to look at yourself from every side.";
  }
  if (state.status === "failed") return "";
  const words = progressText(state);
  return state.status === "working" && state.modelId ? `${words}. ${MEET_EARLY}` : words;
}

function stepLine([step, label]: (typeof STEPS)[number], state: EnrolState): HTMLElement {
  const order = STEPS.map(([key]) => key);
  const passed = order.indexOf(step) - order.indexOf(state.step);
  const done = passed < 0 || state.status === "ready";
  const current = passed === 0 && !done;
  const line = h(
    "li",
    { className: done ? "done" : current ? "current" : "" },
    h("span", { className: "dot" }, done && icon("check")),
    label,
  );
  if (current) line.setAttribute("aria-current", "step");
  return line;
}

function showQuality(report: HTMLElement, sequence: Sequence): void {
  const lines = qualityLines(sequence);
  const hints = advice(sequence);
  report.hidden = lines.length === 0 && hints.length === 0;
  if (report.dataset["of"] === sequence.id && report.childElementCount > 0) return;
  if (report.hidden) return;
  report.dataset["of"] = sequence.id;
  report.replaceChildren(
    h("h2", {}, "Your clip"),
    lineList(lines),
    ...hints.map((hint) => h("p", { className: "hint-line" }, hint)),
  );
}

function lineList(lines: readonly QualityLine[]): HTMLElement {
  const entries = lines.map(({ label, value, level }) => [h("dt", {}, label), h("dd", { className: level }, value)]);
  return h("dl", {}, ...entries.flat());
}
