/** Recorded meetings that we asked for, or agreed to. */

import type { Recording } from "../api/types";
import { h } from "../views/dom";
import type { View } from "../views/shell";
import { clockWords } from "./player";

export function recordingsView(recordings: readonly Recording[]): View {
  const items = recordings.map((one) =>
    h(
      "li",
      {},
      h("a", { href: `/?recording=${one.id}` }, one.name),
      h("span", { className: "small" }, `${whenWords(one.asked_at)}, ${clockWords(1000 * one.duration_s)}, ${namesOf(one)}`),
    ),
  );
  const element = h(
    "main",
    { className: "recordings" },
    h("h1", { tabIndex: -1 }, "Recorded meetings"),
    h(
      "p",
      { className: "small" },
      "Kept as motion, voices and words of those who agreed. Any of them can take themselves out.",
    ),
    items.length > 0 ? h("ul", { testId: "recordings" }, ...items) : h("p", {}, "Nothing has been recorded yet."),
    h("p", {}, h("a", { href: "/" }, "To the start")),
  );
  return { element, close: () => undefined };
}

function whenWords(moment: string): string {
  return new Date(moment).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}

function namesOf({ members }: Recording): string {
  return members.map(({ name }) => name).join(", ") || "nobody is left in it";
}
