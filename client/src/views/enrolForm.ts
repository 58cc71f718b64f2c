/** Name and clip: a file that is chosen or dropped, or guided steps in front of the camera; or keypoints. */

import type { Clip } from "../enrolment/enrol";
import { MOTION_ONLY, isJson } from "../enrolment/keypoints";
import type { NewPerson } from "../api/types";
import { consentForm } from "./consentForm";
import { announce, h } from "./dom";
import { described, fileDrop } from "./fileDrop";
import { heightField } from "./heightField";
import { keypointsForm, type KeypointsHooks } from "./keypointsForm";
import { guideStore } from "../enrolment/recordedSteps";
import { guidedRecorder } from "./guidedRecorder";
import { button, type View } from "./shell";

const ACCEPTED = "video/*,.mp4,.mov,.webm,.mkv,.avi,.zip,.json";
const NAME_KEY = "metanerf.name";

export interface EnrolHooks extends KeypointsHooks {
  onEnrol(newcomer: NewPerson, clip: Clip): void;
}

/** What a form was sent with. */
export interface FilledForm {
  newcomer: NewPerson;
  clip: Clip;
}

/** With `filled`, as it was sent before. */
export function enrolForm(hooks: EnrolHooks, filled: FilledForm | null = null): View {
  let clip: Clip | null = null;
  let recorderView: View | null = null;

  const name = h("input", {
    id: "enrol-name",
    testId: "enrol-name",
    className: "field",
    type: "text",
    maxLength: 80,
    autocomplete: "name",
    placeholder: "Shown to others",
    value: filled?.newcomer.name ?? localStorage.getItem(NAME_KEY) ?? "",
  });
  const height = heightField(filled?.newcomer.height_m);
  const complaint = h("p", { className: "field-error", testId: "enrol-error", attributes: { role: "alert" } });
  const drop = fileDrop({
    title: "Choose a clip, or drop it here",
    kinds: "MP4, MOV or WebM; or a ZIP of images",
    accept: ACCEPTED,
    label: "Choose a clip",
    testId: "enrol-file",
    onFile: (picked) => void choose(picked),
  });
  const choose = async (picked: File): Promise<void> => {
    take({ blob: picked, fileName: picked.name });
    drop.say(described(picked));
    if (!(await isJson(picked)) || clip?.blob !== picked) return;
    take(null);
    drop.clear();
    complaint.textContent = MOTION_ONLY.message;
  };
  const take = (next: Clip | null): void => {
    clip = next;
    complaint.textContent = "";
  };
  const modelOnly = h("input", { type: "checkbox", id: "enrol-model-only", testId: "enrol-model-only", checked: filled?.clip.modelOnly ?? false });
  const consent = consentForm("enrol", filled?.newcomer.consent);
  const body = h("div", { className: "enrol-body" });
  const go = button("Create my model", () => undefined, {
    look: "primary",
    large: true,
    testId: "enrol-submit",
    submit: true,
  });
  const form = h(
    "form",
    { noValidate: true },
    body,
    h(
      "div",
      { className: "person-fields" },
      h("div", {}, h("label", { className: "label", htmlFor: name.id }, "Your name"), name),
      height.element,
      height.words,
    ),
    h(
      "label",
      { className: "small model-only", htmlFor: modelOnly.id },
      modelOnly,
      " Keep only the model: delete the clip after training",
    ),
    consent.element,
    complaint,
    go,
    h("p", { className: "secondary small" }, "The clip is sent to this server only. Training takes about a minute."),
  );
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const called = name.value.trim();
    if (!clip) {
      complaint.textContent = recorderView ? "Record a clip first." : "Choose a clip first.";
      drop.focus();
    } else if (called === "") {
      complaint.textContent = "Enter your name.";
      name.focus();
    } else {
      const height_m = height.read();
      if (height_m === undefined) return;
      localStorage.setItem(NAME_KEY, called);
      hooks.onEnrol({ name: called, height_m, consent: consent.read() }, { ...clip, modelOnly: modelOnly.checked });
    }
  });

  const filmed = (recorded: Clip | null): void => {
    take(recorded);
    if (recorded) announce("Your clip is ready");
  };
  const ways = [
    ["Clip", () => clipForm(drop.element)],
    ["Camera", () => clipForm((recorderView = guidedRecorder(filmed, guideStore)).element)],
    ["Keypoints", () => keypointsForm(hooks)],
  ] as const;
  const clipForm = (source: HTMLElement): HTMLElement => {
    body.replaceChildren(source);
    return form;
  };
  let shown = 0;
  const show = (index: number): void => {
    shown = index;
    recorderView?.close();
    recorderView = null;
    drop.clear();
    take(null);
    const way = ways[index] ?? ways[0];
    element.replaceChildren(tabs, way[1]());
  };
  const { element: tabs, choose: chooseWay } = switcher(ways.map(([label]) => label), show);
  const element = h("div", { className: "card" });
  show(0);
  if (filled) {
    take(filled.clip);
    drop.say(described(new File([filled.clip.blob], filled.clip.fileName)));
    // once the page is there, whose top is another thing
    queueMicrotask(() => element.scrollIntoView?.());
  }
  // whoever reloaded the page amid the steps goes on with them
  const goOn = async (): Promise<void> => {
    const earlier = await guideStore.load();
    if (!earlier || shown !== 0 || clip !== null) return;
    chooseWay(1);
    element.scrollIntoView?.();
  };
  void goOn();
  return { element, close: () => recorderView?.close() };
}

/** Two or more choices of which one holds. */
function switcher(labels: readonly string[], onChoice: (index: number) => void): { element: HTMLElement; choose(index: number): void } {
  const choices: HTMLButtonElement[] = labels.map((label, index) =>
    h("button", {
      type: "button",
      textContent: label,
      onclick: () => {
        choose(index);
        choices[index]?.focus();
      },
      attributes: { "aria-pressed": String(index === 0) },
    }),
  );
  const choose = (index: number): void => {
    choices.forEach((choice, i) => choice.setAttribute("aria-pressed", String(i === index)));
    onChoice(index);
  };
  const attributes = { role: "group", "aria-label": "Source of the clip" };
  return { element: h("div", { className: "switcher", attributes }, ...choices), choose };
}
