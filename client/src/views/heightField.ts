/** How tall somebody is: a field that may stay empty. */

import { h } from "./dom";

const LOWEST_CM = 50;
const HIGHEST_CM = 250;

export interface HeightField {
  element: HTMLElement;
  /** What it is for, and what is wrong with what was typed; wants more room than the field. */
  words: HTMLElement;
  /** In metres, null where it is left empty; undefined where it is no height, which is then told. */
  read(): number | null | undefined;
}

export function heightField(height_m: number | null = null): HeightField {
  const hint = h(
    "p",
    { id: "enrol-height-hint", className: "secondary small" },
    "Your height without shoes, so that your model is life-size next to others.",
  );
  const complaint = h("p", {
    id: "enrol-height-error",
    testId: "height-error",
    className: "field-error",
    attributes: { role: "alert" },
  });
  const field = h("input", {
    id: "enrol-height",
    testId: "enrol-height",
    className: "field",
    type: "text",
    inputMode: "decimal",
    maxLength: 12,
    placeholder: "Optional",
    value: height_m === null ? "" : String(Math.round(1000 * height_m) / 10),
    autocomplete: "off",
    attributes: { "aria-describedby": `${hint.id} ${complaint.id}` },
  });
  const judge = (): number | null | undefined => {
    const height_m = metres(field.value);
    const wrong = height_m === undefined;
    field.setAttribute("aria-invalid", String(wrong));
    complaint.textContent = wrong ? `Enter a height from ${LOWEST_CM} to ${HIGHEST_CM} cm, or leave the field empty.` : "";
    return height_m;
  };
  field.addEventListener("change", judge);
  // who is still typing is not told off, but who mends it sees so at once
  field.addEventListener("input", () => complaint.textContent !== "" && judge());
  const read = (): number | null | undefined => {
    const height_m = judge();
    if (height_m === undefined) field.focus();
    return height_m;
  };
  const label = h("label", { className: "label", htmlFor: field.id }, "Height, cm");
  return { element: h("div", {}, label, field), words: h("div", { className: "height-help" }, hint, complaint), read };
}

/** "178", "178,5 cm" and the like, in metres; null for nothing, undefined for what is no height. */
export function metres(text: string): number | null | undefined {
  const words = text.trim().toLowerCase();
  if (words === "") return null;
  const digits = /^(\d+(?:[.,]\d*)?)\s*(?:cm)?$/.exec(words)?.[1];
  const height_cm = Number(digits?.replace(",", "."));
  return height_cm >= LOWEST_CM && height_cm <= HIGHEST_CM ? height_cm / 100 : undefined;
}
