/** What a model may be used for, and until when: the fields, and how a consent is said in words. */

import type { Consent, NewConsent, Purpose } from "../api/types";
import { h } from "./dom";

const PURPOSES: readonly [Purpose, string, string][] = [
  ["meetings", "Show my model in meetings", "meetings"],
  ["recordings", "Keep it in recordings; you are still asked before each", "recordings"],
  ["driving", "Let others in a meeting move it", "being moved by others"],
  ["learning", "Let it learn from pictures of live look that I keep", "learning from live look"],
];
const USUAL: NewConsent = { purposes: ["meetings", "recordings"], until: null };

export interface ConsentForm {
  element: HTMLFieldSetElement;
  read(): NewConsent;
}

/** `id` tells the fields of several forms on a page apart. */
export function consentForm(id: string, { purposes, until = null }: NewConsent = USUAL): ConsentForm {
  const boxes = PURPOSES.map(([purpose, words]) => {
    const box = h("input", { type: "checkbox", id: `${id}-${purpose}`, testId: `${id}-${purpose}`, checked: purposes.includes(purpose) });
    return { purpose, box, label: h("label", { className: "small", htmlFor: box.id }, box, ` ${words}`) };
  });
  const day = h("input", {
    type: "date",
    id: `${id}-until`,
    testId: `${id}-until`,
    className: "field",
    min: dayOf(new Date()),
    value: until === null ? "" : lastDay(until),
  });
  const [meetings, ...more] = boxes;
  // who is not shown is neither recorded nor moved
  const follow = (): void => more.forEach(({ box }) => (box.disabled = meetings?.box.checked === false));
  meetings?.box.addEventListener("change", follow);
  follow();
  const element = h(
    "fieldset",
    { className: "consent-fields", testId: `${id}-consent` },
    h("legend", { className: "label" }, "What my model may be used for"),
    ...boxes.map(({ label }) => label),
    h("label", { className: "label", htmlFor: day.id }, "Until, including that day"),
    day,
    h("p", { className: "secondary small" }, "Leave the day empty for no end. You can change or revoke this at any time; it takes effect at once."),
  );
  const read = (): NewConsent => ({
    purposes: boxes.filter(({ box }) => box.checked && !box.disabled).map(({ purpose }) => purpose),
    until: day.value === "" ? null : endOf(day.value),
  });
  return { element, read };
}

/** What somebody's model may be used for now, in a sentence. */
export function consentWords({ purposes, until, state, revoked_at }: Consent): string {
  if (state === "revoked") return `Consent revoked${revoked_at === null ? "" : ` on ${written(revoked_at)}`}: the model is shown nowhere.`;
  if (state === "ended") return `Consent ended${until === null ? "" : ` after ${written(justBefore(until))}`}: the model is shown nowhere.`;
  const uses = PURPOSES.filter(([purpose]) => purposes.includes(purpose)).map(([, , use]) => use);
  const end = until === null ? "no end is set" : `until ${written(justBefore(until))}`;
  return uses.length > 0 ? `Consent given for ${uses.join(", ")}; ${end}.` : "Consent given for nothing: only you can see the model.";
}

/** The moment at which a day, of this device's calendar, is over. */
export function endOf(day: string): string {
  const [year = 0, month = 1, date = 1] = day.split("-").map(Number);
  return new Date(year, month - 1, date + 1).toISOString();
}

/** The last day before a moment, as a date field has it. */
export function lastDay(moment: string): string {
  return dayOf(new Date(justBefore(moment)));
}

function justBefore(moment: string): number {
  return Date.parse(moment) - 1;
}

function dayOf(date: Date): string {
  const two = (number: number): string => String(number).padStart(2, "0");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}

function written(moment: string | number): string {
  return new Date(moment).toLocaleDateString(undefined, { dateStyle: "long" });
}
