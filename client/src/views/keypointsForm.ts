/** Keypoints and whom they move: the way to meet somebody by motion alone. */

import type { AnimatablePerson } from "../enrolment/keypoints";
import { asProblem } from "../api/problem";
import { h } from "./dom";
import { described, fileDrop } from "./fileDrop";
import { button } from "./shell";

export interface KeypointsHooks {
  /** Whom keypoints can move. */
  listPeople(): Promise<AnimatablePerson[]>;
  /** Meet them; throws a Problem. */
  onAnimate(person: AnimatablePerson, file: File): Promise<void>;
}

export function keypointsForm(hooks: KeypointsHooks): HTMLElement {
  let file: File | null = null;
  let people: AnimatablePerson[] = [];

  const drop = fileDrop({
    title: "Choose keypoints, or drop them here",
    kinds: "JSON: joint angles or landmarks over time",
    accept: ".json,application/json",
    label: "Choose keypoints",
    testId: "keypoints-file",
    onFile: (picked) => {
      file = picked;
      drop.say(described(picked));
      complaint.textContent = "";
    },
  });
  const who = h("select", { id: "keypoints-who", testId: "keypoints-who", className: "field" });
  const complaint = h("p", { className: "field-error", attributes: { role: "alert" } });
  const go = button("Start the meeting", () => undefined, {
    look: "primary",
    large: true,
    testId: "keypoints-submit",
    submit: true,
  });
  const load = async (): Promise<void> => {
    try {
      people = await hooks.listPeople();
      who.replaceChildren(...people.map(({ name }, i) => h("option", { value: String(i) }, name)));
      if (people.length === 0) complaint.textContent = "There are no models yet. Create one from a clip first.";
      go.disabled = who.disabled = people.length === 0;
    } catch (error) {
      complaint.textContent = asProblem(error).message;
    }
  };
  const move = async (): Promise<void> => {
    const somebody = people[Number(who.value)];
    if (!file || !somebody) {
      complaint.textContent = "Choose a keypoints file first.";
      drop.focus();
      return;
    }
    complaint.textContent = "";
    go.disabled = true;
    try {
      await hooks.onAnimate(somebody, file);
    } catch (error) {
      complaint.textContent = asProblem(error).message;
    } finally {
      go.disabled = false;
    }
  };
  void load();

  const element = h(
    "form",
    { noValidate: true },
    h("div", { className: "enrol-body" }, drop.element),
    h("label", { className: "label", htmlFor: who.id }, "Person to animate"),
    who,
    complaint,
    go,
    h(
      "p",
      { className: "secondary small" },
      "Keypoints animate an existing model. A new person needs a clip.",
    ),
  );
  element.addEventListener("submit", (event) => {
    event.preventDefault();
    void move();
  });
  return element;
}
