/** What was written to all, and where to write. */

import type { MeetingSession } from "../meeting/session";
import { localParticipant } from "../meeting/state";
import type { Said } from "../api/types";
import { h } from "./dom";
import type { Panel } from "./peoplePanel";
import { button } from "./shell";

const MAX_LENGTH = 2000;
/** So close to the end, whoever reads along is taken along. */
const NEAR_END_PX = 60;

export function chatPanel(session: MeetingSession): Panel & { focus(): void } {
  const empty = h("p", { className: "secondary small" }, "Nobody has written yet.");
  const list = h("ol");
  // whoever scrolls by keyboard needs to stand on it; whoever listens is read what is new
  const log = h("div", { className: "messages", tabIndex: 0, testId: "messages" }, list);
  log.setAttribute("role", "log");
  log.setAttribute("aria-label", "Messages");
  const note = h("p", { className: "field-error", attributes: { role: "status" } });
  const field = h("textarea", {
    className: "field",
    rows: 1,
    maxLength: MAX_LENGTH,
    placeholder: "Write to everybody",
    testId: "chat-text",
    attributes: { "aria-label": "Write to everybody" },
  });
  const send = button("Send", () => undefined, { look: "primary", icon: "send", submit: true, testId: "chat-send" });
  const form = h("form", { className: "message-form" }, field, send);
  let shown = 0;

  const say = (): void => {
    const text = field.value.trim();
    if (text === "") return;
    const sent = session.send({ type: "say", text });
    note.textContent = sent ? "" : "Not sent: the connection is lost. Reconnecting…";
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
      const { messages } = session.state;
      const atEnd = log.scrollHeight - log.scrollTop - log.clientHeight < NEAR_END_PX;
      const fresh = messages.filter(({ number }) => number > shown);
      list.append(...fresh.map((one) => message(one, before(messages, one), session.state.me)));
      shown = messages.at(-1)?.number ?? 0;
      empty.hidden = messages.length > 0;
      if (fresh.length > 0 && atEnd) log.scrollTop = log.scrollHeight;
      const quiet = localParticipant(session.state)?.role === "viewer";
      field.disabled = send.disabled = quiet;
      field.placeholder = quiet ? "Viewers cannot write. Raise your hand to speak." : "Write to everybody";
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
      { className: again ? "visually-hidden" : "message-author" },
      h("strong", {}, mine ? "You" : one.name),
      h("time", { dateTime: one.at }, time),
    ),
    h("p", { className: "message-text" }, one.text),
  );
}
