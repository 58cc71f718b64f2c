/** Opens a sealed meeting: with one's own model, or empty. */

import type { AnimatablePerson } from "../enrolment/keypoints";
import { asProblem } from "../api/problem";
import { canSeal } from "../sealing/sealing";
import { h } from "./dom";
import { button } from "./shell";

export interface SealedFormHooks {
  /** Everybody with a model. */
  listPeople(): Promise<AnimatablePerson[]>;
  /** Open it with a model of one's own; null: with nobody yet. Throws a Problem. */
  onSeal(person: AnimatablePerson | null): Promise<void>;
}

const INSECURE = "Only pages that come encrypted (https), or from this device, can do this.";

export function sealedForm(hooks: SealedFormHooks): HTMLElement {
  let people: AnimatablePerson[] = [];
  const who = h("select", { id: "sealed-who", testId: "sealed-who", className: "field" }, h("option", { value: "" }, "Nobody yet"));
  const complaint = h("p", { className: "field-error", attributes: { role: "alert" } });
  const go = button("Open a sealed meeting", () => undefined, { icon: "lock", testId: "sealed-open", submit: true });
  go.disabled = !canSeal();
  if (go.disabled) complaint.textContent = INSECURE;
  const load = async (): Promise<void> => {
    people = (await hooks.listPeople()).filter(({ mine }) => mine);
    const found = people.map(({ name }, i) => h("option", { value: String(i) }, name));
    who.prepend(...found);
    who.selectedIndex = 0;
  };
  const open = async (): Promise<void> => {
    go.disabled = true;
    complaint.textContent = "";
    await hooks.onSeal(people[Number(who.value || NaN)] ?? null).catch((error: unknown) => {
      complaint.textContent = asProblem(error).message;
      go.disabled = false;
    });
  };
  const form = h(
    "form",
    { noValidate: true },
    h("p", {}, "How everybody moves is encrypted from page to page. The key is in the part of the link after the #, which browsers send to nobody: only people with the whole link see each other move, and this server does not."),
    h("p", {}, "Voices, shared screens, chat and names still reach the server readable. Rendering by the server, live look and recordings are not available."),
    h("label", { className: "label", htmlFor: who.id }, "Who comes in with you"),
    h("div", { className: "actions" }, who, go),
    complaint,
  );
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    void open();
  });
  const element = h("details", { className: "seal", testId: "seal" }, h("summary", {}, "Open a sealed meeting"), form);
  // whoever can't be listed can still open an empty one
  element.addEventListener("toggle", () => void load().catch(() => undefined), { once: true });
  return element;
}
