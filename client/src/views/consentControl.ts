/** One person's consent, in their settings: what holds now, and the ways to change and to revoke it. */

import type { Api } from "../api/api";
import { asProblem } from "../api/problem";
import type { Consent, Person } from "../api/types";
import { askTwice } from "./askTwice";
import { consentForm, consentWords } from "./consentForm";
import { announce, h } from "./dom";
import { button } from "./shell";

export function consentControl(api: Api, person: Pick<Person, "id" | "name" | "consent">): HTMLElement {
  const state = h("p", { className: "small", testId: "consent-state" });
  const ways = h("div", { className: "consent-ways" });
  const element = h("div", { className: "consent", testId: "consent" }, h("h4", {}, person.name), state, ways);
  let consent = person.consent;

  const act = async (work: () => Promise<Consent>): Promise<void> => {
    try {
      consent = await work();
      rest();
      announce(state.textContent);
    } catch (error) {
      const { title, detail } = asProblem(error);
      state.textContent = `${title}. ${detail}`;
      announce(state.textContent);
    }
  };
  const edit = (): void => {
    const form = consentForm(`consent-${person.id}`, consent);
    const save = button("Save", () => undefined, { look: "primary", submit: true, testId: "consent-save" });
    const whole = h("form", { noValidate: true }, form.element, h("div", { className: "actions" }, save, button("Cancel", rest)));
    whole.addEventListener("submit", (event) => {
      event.preventDefault();
      void act(() => api.giveConsent(person.id, form.read()));
    });
    ways.replaceChildren(whole);
    form.element.querySelector("input")?.focus();
  };
  const rest = (): void => {
    const given = consent.state === "given";
    state.textContent = consentWords(consent);
    element.dataset["state"] = consent.state;
    const change = button(given ? "Change consent" : "Give consent again", edit, { testId: "consent-change" });
    ways.replaceChildren(change, ...(given ? [revoke()] : []));
  };
  const revoke = (): HTMLElement =>
    askTwice(
      {
        ask: "Revoke consent",
        question: `Revoke the consent of ${person.name}?`,
        words: "Your model disappears at once from meetings, also from those that are running, and from recordings. Nothing is deleted, and you can give your consent again.",
        yes: "Revoke",
        no: "Keep",
        testId: "consent-revoke",
      },
      () => act(() => api.revokeConsent(person.id)),
    );
  rest();
  return element;
}
