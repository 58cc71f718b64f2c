/** What leaves this device, said plainly, and the way to be forgotten. */

import type { Api } from "../api/api";
import { Problem, asProblem } from "../api/problem";
import type { Person } from "../api/types";
import { announce, h } from "./dom";
import { button } from "./shell";

const DATA_SENT = [
  "Your viewpoint and your name, while you are in a meeting.",
  "Your movements, as 33 body landmarks and seventeen values for face, eyes and fingers, while they are tracked. Camera images stay on this device.",
  "With live look, which you switch on in a meeting: a small picture of you, cut out of your room, while it is on. It is not stored.",
  "Your voice and your screen, while you share them.",
  "The clip you record to create your model, and your height if you enter it. “Erase me” deletes both.",
];

/** `onErased` hears of each person of ours who is gone. */
export function privacyPanel(api: Api, onErased: () => void): { element: HTMLElement; load(): Promise<void> } {
  const people = h("div", { className: "erase-list", testId: "erase-list" });
  const told = h("p", { className: "small", attributes: { role: "status" } });
  const element = h(
    "section",
    { className: "privacy", testId: "privacy" },
    h("h3", {}, "What leaves this device"),
    h("ul", { className: "tips small" }, ...DATA_SENT.map((words) => h("li", {}, words))),
    people,
    told,
  );
  const load = async (): Promise<void> => {
    const mine = await api.people().catch((error: unknown) => {
      // who was only invited to look has nobody here
      if (error instanceof Problem && error.status === 403) return [];
      return null;
    });
    if (mine) people.replaceChildren(...mine.filter((person) => person.mine).map((person) => eraseControl(person, erase)));
  };
  const erase = async ({ id, name }: Person): Promise<void> => {
    try {
      await api.erasePerson(id);
      told.textContent = `${name} has been erased, with every clip, model and recording.`;
      announce(told.textContent);
      onErased();
      await load();
    } catch (error) {
      const { title, detail } = asProblem(error);
      told.textContent = `${title}. ${detail}`;
    }
  };
  return { element, load };
}

/** Asks once more: what is erased does not come back. */
function eraseControl(person: Person, onErase: (person: Person) => Promise<void>): HTMLElement {
  const ask = button(`Erase me: ${person.name}`, () => sure(true), { testId: "erase" });
  const yes = button("Erase everything", () => void go(), { look: "danger", testId: "erase-sure" });
  const no = button("Keep", () => sure(false));
  const question = h("div", { className: "actions", hidden: true, attributes: { role: "group" } }, yes, no);
  question.setAttribute("aria-label", `Erase ${person.name} for good?`);
  const words = h("p", { className: "small", hidden: true }, "Your clips, models and recordings are deleted permanently, and your model disappears from meetings.");
  const sure = (asking: boolean): void => {
    question.hidden = words.hidden = !asking;
    ask.hidden = asking;
    (asking ? no : ask).focus();
  };
  const go = async (): Promise<void> => {
    yes.disabled = true;
    await onErase(person);
    yes.disabled = false;
  };
  return h("div", { className: "erase" }, ask, words, question);
}
