/** Keypoints and whom they move: the way to meet somebody by motion alone. */

import type { Somebody } from "../enrolment/keypoints";
import { asProblem } from "../api/problem";
import { h } from "./dom";
import { described, fileDrop } from "./fileDrop";
import { button } from "./shell";

export interface KeypointsHooks {
  /** Whom keypoints can move. */
  everybody(): Promise<Somebody[]>;
  /** Meet them; throws a Problem. */
  onMove(somebody: Somebody, file: File): Promise<void>;
}

export function keypointsForm(hooks: KeypointsHooks): HTMLElement {
  let file: File | null = null;
  let people: Somebody[] = [];

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
  const complaint = h("p", { className: "complaint", attributes: { role: "alert" } });
  const go = button("Meet them moving", () => undefined, {
    look: "primary",
    large: true,
    testId: "keypoints-submit",
    submit: true,
  });
  const load = async (): Promise<void> => {
    try {
      people = await hooks.everybody();
      who.replaceChildren(...people.map(({ name }, i) => h("option", { value: String(i) }, name)));
      if (people.length === 0) complaint.textContent = "Nobody is here yet; bring somebody in by a clip first.";
      go.disabled = who.disabled = people.length === 0;
    } catch (error) {
      complaint.textContent = asProblem(error).message;
    }
  };
  const move = async (): Promise<void> => {
    const somebody = people[Number(who.value)];
    if (!file || !somebody) {
      complaint.textContent = "Choose a file of keypoints first.";
      drop.focus();
      return;
    }
    complaint.textContent = "";
    go.disabled = true;
    try {
      await hooks.onMove(somebody, file);
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
    h("label", { className: "label", htmlFor: who.id }, "Who moves"),
    who,
    complaint,
    go,
    h(
      "p",
      { className: "soft small" },
      "Keypoints move somebody who is here already; a new person needs a clip.",
    ),
  );
  element.addEventListener("submit", (event) => {
    event.preventDefault();
    void move();
  });
  return element;
}
