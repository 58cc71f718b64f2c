/** Who is here, who waits, and what the host may do about it. */

import type { MeetingSession } from "../meeting/session";
import { admittedMembers, isHost, waitingMembers } from "../meeting/state";
import { asProblem } from "../api/problem";
import type { Connection, Member } from "../api/types";
import { askTwice } from "./askTwice";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { button } from "./shell";

export interface Panel {
  element: HTMLElement;
  update(): void;
}

interface Row {
  element: HTMLElement;
  update(member: Member): void;
}

export function peoplePanel(session: MeetingSession): Panel {
  const waitingTitle = h("h3", {}, "Waiting in the lobby");
  const waitingList = h("ul", { className: "members", testId: "waiting-people" });
  const list = h("ul", { className: "members", testId: "members" });
  const lobby = lobbySwitch(session);
  const hosting = h("div", { className: "panel-footer" }, renewButton(session), endButton(session));
  const waitingRows = new Map<string, Row>();
  const rows = new Map<string, Row>();
  const element = h("div", { className: "panel-body" }, lobby.element, waitingTitle, waitingList, list, hosting);
  return {
    element,
    update: () => {
      const { state } = session;
      const host = isHost(state);
      const knocking = waitingMembers(state);
      lobby.update();
      lobby.element.hidden = hosting.hidden = !host;
      waitingTitle.hidden = waitingList.hidden = knocking.length === 0;
      arrange(waitingList, waitingRows, knocking, () => waitingRow(session));
      arrange(list, rows, admittedMembers(state), () => memberRow(session));
    },
  };
}

/** Keep one row a member, in order; rows stay the same elements, so that no focus is lost. */
function arrange(list: HTMLElement, rows: Map<string, Row>, members: Member[], make: () => Row): void {
  const there = new Set(members.map(({ id }) => id));
  for (const [id, row] of rows) {
    if (there.has(id)) continue;
    row.element.remove();
    rows.delete(id);
  }
  members.forEach((member, place) => {
    let row = rows.get(member.id);
    if (!row) rows.set(member.id, (row = make()));
    row.update(member);
    const next = list.children[place] ?? null;
    if (next !== row.element) list.insertBefore(row.element, next);
  });
}

function waitingRow(session: MeetingSession): Row {
  const name = h("span", { className: "member-name" });
  let id = "";
  const admit = button("Let in", () => session.send({ type: "admit", participant_id: id }), {
    look: "primary",
    testId: "admit",
  });
  const deny = button("Deny", () => session.send({ type: "deny", participant_id: id }), { testId: "deny" });
  const element = h("li", { className: "member" }, name, h("span", { className: "member-actions" }, admit, deny));
  return {
    element,
    update: (member) => {
      id = member.id;
      name.textContent = member.name;
      admit.setAttribute("aria-label", `Let in: ${member.name}`);
      deny.setAttribute("aria-label", `Deny: ${member.name}`);
    },
  };
}

function memberRow(session: MeetingSession): Row {
  const face = h("span", { className: "initial", attributes: { "aria-hidden": "true" } });
  const name = h("span", { className: "member-name" });
  const what = h("span", { className: "member-status" });
  const hand = h("span", { className: "member-hand" }, icon("hand"), h("span", { className: "visually-hidden" }, "Hand raised"));
  const ways = hostActions(session);
  const more = button("More", () => show(ways.element.hidden !== false), { icon: "more", testId: "member-more" });
  const show = (shown: boolean): void => {
    ways.element.hidden = !shown;
    more.setAttribute("aria-expanded", String(shown));
  };
  more.classList.add("icon-only");
  show(false);
  const words = h("span", { className: "member-text" }, name, what);
  const heard = h("span", { className: "member-microphone" }, icon("mic"), h("span", { className: "visually-hidden" }, "Microphone on"));
  const network = connectionMark();
  const element = h("li", { className: "member" }, face, words, hand, heard, network.element, more, ways.element);
  return {
    element,
    update: (member) => {
      const mine = member.id === session.state.me;
      element.classList.toggle("away", !member.present);
      face.textContent = [...member.name][0]?.toUpperCase() ?? "";
      name.textContent = mine ? `${member.name} (you)` : member.name;
      what.textContent = memberStatus(member);
      hand.hidden = member.hand_at === null;
      heard.hidden = !member.microphone;
      network.show(member);
      element.classList.toggle("speaking", session.state.speaking.includes(member.id));
      more.hidden = mine || !isHost(session.state);
      more.setAttribute("aria-label", `More about ${member.name}`);
      if (more.hidden) show(false);
      ways.update(member);
    },
  };
}

const CONNECTIONS: Record<Connection, string> = { good: "Good connection", fair: "Fair connection", poor: "Poor connection" };

/** Three bars, as many full as the network is good. */
function connectionMark(): { element: HTMLElement; show(member: Member): void } {
  const told = h("span", { className: "visually-hidden" });
  const bars = h("span", { className: "bars", attributes: { "aria-hidden": "true" } }, h("i"), h("i"), h("i"));
  const element = h("span", { className: "member-network", testId: "network" }, bars, told);
  return {
    element,
    show: ({ connection, present }) => {
      element.hidden = connection === null || !present;
      element.dataset["connection"] = connection ?? "";
      element.title = told.textContent = connection ? CONNECTIONS[connection] : "";
    },
  };
}

function memberStatus({ role, present }: Member): string {
  if (!present) return "Connection lost";
  return { host: "Host", speaker: "", viewer: "Viewer" }[role];
}

/** What the host may do with somebody. */
function hostActions(session: MeetingSession): Row {
  let shown: Member | null = null;
  const to = (role: Member["role"]) => (): void => {
    if (shown) session.send({ type: "role", participant_id: shown.id, role });
  };
  const remove = (): void => {
    if (shown) session.send({ type: "remove", participant_id: shown.id });
  };
  const mute = button("Mute", () => shown && session.send({ type: "mute", participant_id: shown.id }), {
    testId: "mute",
  });
  const look = button("Make viewer", () => to(shown?.role === "viewer" ? "speaker" : "viewer")());
  const ways: [HTMLButtonElement, string][] = [
    [mute, "Mute"],
    [button("Make host", to("host"), { testId: "make-host" }), "Make host"],
    [look, "Make viewer"],
    [button("Remove", remove, { testId: "remove" }), "Remove"],
  ];
  const element = h("div", { className: "member-host-actions" }, ...ways.map(([way]) => way));
  return {
    element,
    update: (member) => {
      shown = member;
      mute.hidden = !member.microphone;
      const words = member.role === "viewer" ? "Make speaker" : "Make viewer";
      look.replaceChildren(h("span", {}, words));
      ways.forEach(([way, label]) => {
        way.setAttribute("aria-label", `${way === look ? words : label}: ${member.name}`);
      });
    },
  };
}

/** So long a switch stands as it was set, whatever else the server says. */
const ANSWER_TIMEOUT_MS = 2000;

function lobbySwitch(session: MeetingSession): { element: HTMLElement; update(): void } {
  const box = h("input", { type: "checkbox", id: "lobby-switch", testId: "lobby", attributes: { role: "switch" } });
  let askedAtMs = -Infinity;
  const update = (): void => {
    const said = session.state.lobby;
    // the server's word counts; what it said of others meanwhile is no answer
    if (said !== box.checked && performance.now() - askedAtMs < ANSWER_TIMEOUT_MS) return;
    box.checked = said;
  };
  box.addEventListener("change", () => {
    const on = box.checked;
    if (!session.send({ type: "lobby", on })) box.checked = !on;
    else {
      askedAtMs = performance.now();
      setTimeout(update, ANSWER_TIMEOUT_MS);
    }
  });
  const label = h("label", { attributes: { for: box.id } }, "Admit participants one at a time");
  return {
    element: h("div", { className: "switch-row" }, label, box),
    update,
  };
}

/** A new invitation, for when the link has come to somebody who is not to come. */
function renewButton(session: MeetingSession): HTMLElement {
  const told = h("p", { className: "small", testId: "invitation-told", attributes: { role: "status" } });
  const renew = async (): Promise<void> => {
    try {
      await session.renewInvitation();
      told.textContent = "The old link no longer works. “Copy invite link” now copies the new one.";
    } catch (error) {
      const { title, detail } = asProblem(error);
      told.textContent = `${title}. ${detail}`;
    }
    announce(told.textContent);
  };
  const asking = askTwice(
    {
      ask: "Renew the invitation",
      question: "Renew the invitation?",
      words: "The link that was sent so far stops working, and so does joining by the meeting’s id. Whoever is in the meeting stays in it.",
      yes: "Renew",
      no: "Keep the old link",
      testId: "renew-invitation",
    },
    renew,
  );
  return h("div", {}, asking, told);
}

/** Asks once more: nobody comes back from it. */
function endButton(session: MeetingSession): HTMLElement {
  const question = "End the meeting for everybody?";
  return askTwice({ ask: "End for everybody", question, yes: "End meeting", no: "Cancel", testId: "end", focus: "yes" }, () => void session.send({ type: "end" }));
}
