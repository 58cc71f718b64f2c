/** Recorded meetings that we asked for, or agreed to. */

import type { Recording } from "../api/types";
import { h } from "../views/dom";
import type { View } from "../views/shell";
import { clockText } from "./player";

export function recordingsView(recordings: readonly Recording[]): View {
  const items = recordings.map((one) =>
    h(
      "li",
      {},
      h("a", { href: `/?recording=${one.id}` }, one.name),
      h("span", { className: "small" }, `${dateText(one.asked_at)}, ${clockText(1000 * one.duration_s)}, ${memberNames(one)}`),
    ),
  );
  const element = h(
    "main",
    { className: "recordings" },
    h("h1", { tabIndex: -1 }, "Recorded meetings"),
    h(
      "p",
      { className: "small" },
      "Motion, voices and messages of the participants who agreed. Each of them can delete their own part.",
    ),
    items.length > 0 ? h("ul", { testId: "recordings" }, ...items) : h("p", {}, "Nothing has been recorded yet."),
    h("p", {}, h("a", { href: "/" }, "Back to the start")),
  );
  return { element, close: () => undefined };
}

function dateText(moment: string): string {
  return new Date(moment).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}

function memberNames({ members }: Recording): string {
  return members.map(({ name }) => name).join(", ") || "no participants left";
}
