/** What leaves this device, said plainly, what one's model may be used for, and the way to be forgotten. */

import type { Api } from "../api/api";
import { Problem, asProblem } from "../api/problem";
import type { Person } from "../api/types";
import { askTwice } from "./askTwice";
import { consentControl } from "./consentControl";
import { announce, h } from "./dom";

const DATA_SENT = [
  "Your viewpoint and your name, while you are in a meeting.",
  "Your movements, as the rotations of 24 joints, where you stand and seventeen values for face, eyes and fingers, while they are tracked; in a sealed meeting encrypted, for the others alone. Camera images stay on this device.",
  "With live look, which you switch on in a meeting: a small picture of you, cut out of your room, while it is on. It is not stored.",
  "Your voice and your screen, while you share them.",
  "The clip you record to create your model, and your height if you enter it. “Erase me” deletes both.",
];

/** `onErased` hears of each person of ours who is gone. */
export function privacyPanel(api: Api, onErased: () => void): { element: HTMLElement; load(): Promise<void> } {
  const people = h("div", { className: "erase-list", testId: "erase-list" });
  const consent = h("div", { hidden: true }, h("h3", {}, "Your consent"), people);
  const told = h("p", { className: "small", attributes: { role: "status" } });
  const element = h(
    "section",
    { className: "privacy", testId: "privacy" },
    h("h3", {}, "What leaves this device"),
    h("ul", { className: "tips small" }, ...DATA_SENT.map((words) => h("li", {}, words))),
    consent,
    told,
  );
  const load = async (): Promise<void> => {
    const mine = await api.people().catch((error: unknown) => {
      // who was only invited to look has nobody here
      if (error instanceof Problem && error.status === 403) return [];
      return null;
    });
    if (!mine) return;
    people.replaceChildren(...mine.filter((person) => person.mine).map((person) => personControls(api, person, erase)));
    consent.hidden = people.childElementCount === 0;
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

/** What one of our people consents to, and the way to erase them. */
function personControls(api: Api, person: Person, onErase: (person: Person) => Promise<void>): HTMLElement {
  const erase = askTwice(
    {
      ask: `Erase me: ${person.name}`,
      question: `Erase ${person.name} for good?`,
      words: "Your clips, models and recordings are deleted permanently, and your model disappears from meetings.",
      yes: "Erase everything",
      no: "Keep",
      testId: "erase",
    },
    () => onErase(person),
  );
  return h("div", { className: "person-controls" }, consentControl(api, person), erase);
}
