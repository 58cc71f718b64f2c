/** Who is here, who waits, and what the host may do about it. */

import type { Attendance } from "../meeting/attendance";
import { inside, isHost, waiting } from "../meeting/state";
import type { Connection, Member } from "../api/types";
import { h } from "./dom";
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

export function peoplePanel(attendance: Attendance): Panel {
  const waitingTitle = h("h3", {}, "Waiting to come in");
  const waitingList = h("ul", { className: "members", testId: "waiting-people" });
  const list = h("ul", { className: "members", testId: "members" });
  const lobby = lobbySwitch(attendance);
  const end = endButton(attendance);
  const waitingRows = new Map<string, Row>();
  const rows = new Map<string, Row>();
  const element = h("div", { className: "panel-body" }, lobby.element, waitingTitle, waitingList, list, end);
  return {
    element,
    update: () => {
      const { state } = attendance;
      const host = isHost(state);
      const knocking = waiting(state);
      lobby.update();
      lobby.element.hidden = end.hidden = !host;
      waitingTitle.hidden = waitingList.hidden = knocking.length === 0;
      arrange(waitingList, waitingRows, knocking, () => waitingRow(attendance));
      arrange(list, rows, inside(state), () => memberRow(attendance));
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

function waitingRow(attendance: Attendance): Row {
  const name = h("span", { className: "member-name" });
  let id = "";
  const admit = button("Let in", () => attendance.wish({ type: "admit", participant_id: id }), {
    look: "primary",
    testId: "admit",
  });
  const deny = button("Deny", () => attendance.wish({ type: "deny", participant_id: id }), { testId: "deny" });
  const element = h("li", { className: "member" }, name, h("span", { className: "member-ways" }, admit, deny));
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

function memberRow(attendance: Attendance): Row {
  const face = h("span", { className: "face", attributes: { "aria-hidden": "true" } });
  const name = h("span", { className: "member-name" });
  const what = h("span", { className: "member-what" });
  const hand = h("span", { className: "member-hand" }, icon("hand"), h("span", { className: "unseen" }, "Hand raised"));
  const ways = hostWays(attendance);
  const more = button("More", () => show(ways.element.hidden !== false), { icon: "more", testId: "member-more" });
  const show = (shown: boolean): void => {
    ways.element.hidden = !shown;
    more.setAttribute("aria-expanded", String(shown));
  };
  more.classList.add("bare");
  show(false);
  const words = h("span", { className: "member-words" }, name, what);
  const heard = h("span", { className: "member-heard" }, icon("mic"), h("span", { className: "unseen" }, "Microphone on"));
  const carried = connectionMark();
  const element = h("li", { className: "member" }, face, words, hand, heard, carried.element, more, ways.element);
  return {
    element,
    update: (member) => {
      const mine = member.id === attendance.state.me;
      element.classList.toggle("away", !member.present);
      face.textContent = [...member.name][0]?.toUpperCase() ?? "";
      name.textContent = mine ? `${member.name} (you)` : member.name;
      what.textContent = inWords(member);
      hand.hidden = member.hand_at === null;
      heard.hidden = !member.microphone;
      carried.show(member);
      element.classList.toggle("speaking", attendance.state.speaking.includes(member.id));
      more.hidden = mine || !isHost(attendance.state);
      more.setAttribute("aria-label", `More about ${member.name}`);
      if (more.hidden) show(false);
      ways.update(member);
    },
  };
}

const CONNECTIONS: Record<Connection, string> = { good: "Good connection", fair: "Fair connection", poor: "Poor connection" };

/** Three bars, as many full as the network is good. */
function connectionMark(): { element: HTMLElement; show(member: Member): void } {
  const told = h("span", { className: "unseen" });
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

function inWords({ role, present }: Member): string {
  if (!present) return "Connection lost";
  return { host: "Host", speaker: "", viewer: "Looking on" }[role];
}

/** What the host may do with somebody. */
function hostWays(attendance: Attendance): Row {
  let shown: Member | null = null;
  const to = (role: Member["role"]) => (): void => {
    if (shown) attendance.wish({ type: "role", participant_id: shown.id, role });
  };
  const remove = (): void => {
    if (shown) attendance.wish({ type: "remove", participant_id: shown.id });
  };
  const mute = button("Mute", () => shown && attendance.wish({ type: "mute", participant_id: shown.id }), {
    testId: "mute",
  });
  const look = button("Only look on", () => to(shown?.role === "viewer" ? "speaker" : "viewer")());
  const ways: [HTMLButtonElement, string][] = [
    [mute, "Mute"],
    [button("Make host", to("host"), { testId: "make-host" }), "Make host"],
    [look, "Only look on"],
    [button("Send out", remove, { testId: "remove" }), "Send out"],
  ];
  const element = h("div", { className: "member-more" }, ...ways.map(([way]) => way));
  return {
    element,
    update: (member) => {
      shown = member;
      mute.hidden = !member.microphone;
      const words = member.role === "viewer" ? "Let speak" : "Only look on";
      look.replaceChildren(h("span", {}, words));
      ways.forEach(([way, label]) => {
        way.setAttribute("aria-label", `${way === look ? words : label}: ${member.name}`);
      });
    },
  };
}

/** So long a switch stands as it was set, whatever else the server says. */
const ANSWERED_IN_MS = 2000;

function lobbySwitch(attendance: Attendance): { element: HTMLElement; update(): void } {
  const box = h("input", { type: "checkbox", id: "lobby-switch", testId: "lobby", attributes: { role: "switch" } });
  let askedAtMs = -Infinity;
  const update = (): void => {
    const said = attendance.state.lobby;
    // the server's word counts; what it said of others meanwhile is no answer
    if (said !== box.checked && performance.now() - askedAtMs < ANSWERED_IN_MS) return;
    box.checked = said;
  };
  box.addEventListener("change", () => {
    const on = box.checked;
    if (!attendance.wish({ type: "lobby", on })) box.checked = !on;
    else {
      askedAtMs = performance.now();
      setTimeout(update, ANSWERED_IN_MS);
    }
  });
  const label = h("label", { attributes: { for: box.id } }, "Let people in one by one");
  return {
    element: h("div", { className: "switch-line" }, label, box),
    update,
  };
}

/** Asks once more: nobody comes back from it. */
function endButton(attendance: Attendance): HTMLElement {
  const ask = button("End for everybody", () => sure(true), { testId: "end" });
  const yes = button("End it", () => attendance.wish({ type: "end" }), { look: "danger", testId: "end-sure" });
  const no = button("Go on", () => sure(false));
  const question = h("div", { className: "ways", attributes: { role: "group" } }, yes, no);
  question.setAttribute("aria-label", "End the meeting for everybody?");
  const sure = (asking: boolean): void => {
    question.hidden = !asking;
    ask.hidden = asking;
    (asking ? yes : ask).focus();
  };
  question.hidden = true;
  return h("div", { className: "panel-end" }, ask, question);
}
