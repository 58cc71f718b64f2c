/** What was written to all, and where to write. */

import type { Attendance } from "../meeting/attendance";
import { myself } from "../meeting/state";
import type { Said } from "../api/types";
import { h } from "./dom";
import type { Panel } from "./peoplePanel";
import { button } from "./shell";

const LONGEST = 2000;
/** So close to the end, whoever reads along is taken along. */
const NEAR_END_PX = 60;

export function chatPanel(attendance: Attendance): Panel & { focus(): void } {
  const empty = h("p", { className: "soft small" }, "Nobody has written yet.");
  const list = h("ol");
  // whoever scrolls by keyboard needs to stand on it; whoever listens is read what is new
  const log = h("div", { className: "said", tabIndex: 0, testId: "said" }, list);
  log.setAttribute("role", "log");
  log.setAttribute("aria-label", "Messages");
  const note = h("p", { className: "complaint", attributes: { role: "status" } });
  const field = h("textarea", {
    className: "field",
    rows: 1,
    maxLength: LONGEST,
    placeholder: "Write to everybody",
    testId: "chat-text",
    attributes: { "aria-label": "Write to everybody" },
  });
  const send = button("Send", () => undefined, { look: "primary", icon: "send", submit: true, testId: "chat-send" });
  const form = h("form", { className: "say" }, field, send);
  let shown = 0;

  const say = (): void => {
    const text = field.value.trim();
    if (text === "") return;
    const sent = attendance.wish({ type: "say", text });
    note.textContent = sent ? "" : "Not sent: the connection is lost. It comes back by itself.";
    if (sent) field.value = "";
  };
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    say();
  });
  field.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.shiftKey || event.isComposing) return;
    event.preventDefault();
    say();
  });

  return {
    element: h("div", { className: "panel-body chat" }, empty, log, note, form),
    update: () => {
      const { said } = attendance.state;
      const atEnd = log.scrollHeight - log.scrollTop - log.clientHeight < NEAR_END_PX;
      const fresh = said.filter(({ number }) => number > shown);
      list.append(...fresh.map((one) => message(one, before(said, one), attendance.state.me)));
      shown = said.at(-1)?.number ?? 0;
      empty.hidden = said.length > 0;
      if (fresh.length > 0 && atEnd) log.scrollTop = log.scrollHeight;
      const quiet = myself(attendance.state)?.role === "viewer";
      field.disabled = send.disabled = quiet;
      field.placeholder = quiet ? "You are looking on: raise a hand to speak" : "Write to everybody";
    },
    focus: () => {
      log.scrollTop = log.scrollHeight;
      (field.disabled ? log : field).focus();
    },
  };
}

function before(said: readonly Said[], one: Said): Said | null {
  return said[said.indexOf(one) - 1] ?? null;
}

function message(one: Said, last: Said | null, me: string | null): HTMLElement {
  const time = new Date(one.at).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
  const mine = one.participant_id === me;
  // whoever goes on writing is not named again
  const again = last?.participant_id === one.participant_id;
  return h(
    "li",
    { className: `${mine ? "mine" : ""}${again ? " again" : ""}` },
    h(
      "p",
      { className: again ? "unseen" : "said-by" },
      h("strong", {}, mine ? "You" : one.name),
      h("time", { dateTime: one.at }, time),
    ),
    h("p", { className: "said-text" }, one.text),
  );
}
