/**
 * The menu panel in a headset and its layout: the labels of the page, in the order of the page.
 * Pixels of the panel from its upper left corner. No DOM in here.
 */

import { admittedMembers, localParticipant, type MeetingState, type Reaction } from "../meeting/state";
import type { ToServer } from "../api/types";
import type { IconName } from "../views/icons";

export const MENU_PX = { width: 1024, height: 760 } as const;

export type Sheet = "people" | "chat" | "react";

/** What a press does. */
export type MenuAction =
  | { kind: "microphone" }
  | { kind: "leave" }
  | { kind: "sheet"; sheet: Sheet }
  | { kind: "send"; message: ToServer }
  | { kind: "turn"; way: 1 | -1 }
  | { kind: "height" };

export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

export interface MenuItem extends Box {
  /** A button, a line of a list, or the sheet that lies behind them. */
  kind: "button" | "line" | "sheet";
  label: string;
  /** In front of a line's label, and stronger. */
  strong?: string;
  icon?: IconName;
  pressed?: boolean;
  disabled?: boolean;
  action?: MenuAction;
}

const GAP = 12;
const ROW = 92;
const DOCK_Y = MENU_PX.height - 2 * (ROW + GAP);
const SHEET: Box = { x: 0, y: 0, width: MENU_PX.width, height: DOCK_Y - GAP };
const TITLE = 72;
const LINE = 56;
const MOST_LINES = 7;
const MOST_MESSAGES = 5;
const REPLY = 76;

const REACTIONS: readonly (readonly [Reaction, string])[] = [
  ["agree", "Agree"],
  ["applause", "Applause"],
  ["heart", "Heart"],
  ["laugh", "Laugh"],
  ["surprise", "Surprise"],
  ["party", "Celebrate"],
];
/** What one may write without a keyboard. */
export const REPLIES = ["Yes", "No", "One moment", "I can’t hear you", "Thank you"] as const;
/** So many of them lie side by side, the longer ones below. */
const SHORT_REPLIES = 3;

/** Everything on the board, the foremost last. */
export function menuItems(state: MeetingState, sheet: Sheet | null, standing: boolean): MenuItem[] {
  return [...(sheet ? sheetItems(state, sheet) : []), ...dock(state, sheet), ...moves(standing)];
}

/** What lies under a point, if it can be pressed. */
export function itemAt(items: readonly MenuItem[], x: number, y: number): MenuItem | null {
  const under = items.filter((item) => x >= item.x && y >= item.y && x < item.x + item.width && y < item.y + item.height);
  const front = under.at(-1);
  return front?.action && !front.disabled ? front : null;
}

/** Equal parts of a row, with gaps between them. */
export function splitRow(count: number, row: Box): Box[] {
  const width = (row.width - GAP * (count - 1)) / count;
  return Array.from({ length: count }, (_, nth) => ({ ...row, x: row.x + nth * (width + GAP), width }));
}

function layOut(row: Box, items: readonly Omit<MenuItem, keyof Box | "kind">[]): MenuItem[] {
  const places = splitRow(items.length, row);
  return items.map((item, nth) => ({ kind: "button", ...item, ...(places[nth] ?? row) }));
}

function dock(state: MeetingState, open: Sheet | null): MenuItem[] {
  const me = localParticipant(state);
  const on = me?.microphone ?? false;
  const raised = me?.hand_at != null;
  const sheet = (which: Sheet): Pick<MenuItem, "action" | "pressed"> => ({
    action: { kind: "sheet", sheet: which },
    pressed: open === which,
  });
  const row = { x: 0, y: DOCK_Y, width: MENU_PX.width, height: ROW };
  return layOut(row, [
    { label: "People", icon: "people", ...sheet("people") },
    { label: "Chat", icon: "chat", ...sheet("chat") },
    { label: on ? "Mute" : "Unmute", icon: on ? "mic" : "micOff", pressed: on, disabled: me?.role === "viewer", action: { kind: "microphone" } },
    { label: "Raise hand", icon: "hand", pressed: raised, action: { kind: "send", message: { type: "hand", raised: !raised } } },
    { label: "React", icon: "smile", ...sheet("react") },
    { label: "Leave", icon: "leave", action: { kind: "leave" } },
  ]);
}

function moves(standing: boolean): MenuItem[] {
  const row = { x: 0, y: DOCK_Y + ROW + GAP, width: MENU_PX.width, height: ROW };
  return layOut(row, [
    { label: "Turn left", action: { kind: "turn", way: 1 } },
    { label: standing ? "Sit down" : "Stand up", pressed: standing, action: { kind: "height" } },
    { label: "Turn right", action: { kind: "turn", way: -1 } },
  ]);
}

function sheetItems(state: MeetingState, sheet: Sheet): MenuItem[] {
  const behind: MenuItem = { kind: "sheet", label: { people: "People", chat: "Chat", react: "React" }[sheet], ...SHEET };
  if (sheet === "people") return [behind, ...people(state)];
  if (sheet === "chat") return [behind, ...chat(state)];
  return [behind, ...reactions()];
}

function line(nth: number, item: Pick<MenuItem, "label" | "strong" | "icon">): MenuItem {
  const { x, width } = SHEET;
  return { kind: "line", ...item, x: x + 2 * GAP, y: TITLE + nth * LINE, width: width - 4 * GAP, height: LINE };
}

function people(state: MeetingState): MenuItem[] {
  const all = admittedMembers(state);
  const shown = all.length > MOST_LINES ? all.slice(0, MOST_LINES - 1) : all;
  const lines = shown.map(({ id, name, microphone, hand_at }, nth) =>
    line(nth, {
      label: id === state.me ? `${name} (you)` : name,
      icon: hand_at !== null ? "hand" : microphone ? "mic" : "micOff",
    }),
  );
  if (shown.length < all.length) lines.push(line(lines.length, { label: `and ${all.length - shown.length} more` }));
  return lines;
}

function chat(state: MeetingState): MenuItem[] {
  const last = state.messages.slice(-MOST_MESSAGES);
  const lines = last.map(({ participant_id, name, text }, nth) =>
    line(nth, { strong: participant_id === state.me ? "You" : name, label: text }),
  );
  if (last.length === 0) lines.push(line(0, { label: "Nobody has written yet." }));
  const quiet = localParticipant(state)?.role === "viewer";
  const replies = REPLIES.map((text) => ({ label: text, disabled: quiet, action: { kind: "send", message: { type: "say", text } } as const }));
  const rows = [replies.slice(0, SHORT_REPLIES), replies.slice(SHORT_REPLIES)];
  const placed = rows.map((some, nth) => {
    const y = SHEET.height - (rows.length - nth) * (REPLY + GAP);
    return layOut({ x: 2 * GAP, y, width: SHEET.width - 4 * GAP, height: REPLY }, some);
  });
  return [...lines, ...placed.flat()];
}

function reactions(): MenuItem[] {
  const [above, below] = [REACTIONS.slice(0, 3), REACTIONS.slice(3)];
  return [above, below].flatMap((some, nth) => {
    const row = { x: 2 * GAP, y: TITLE + GAP + nth * (2 * ROW + GAP), width: SHEET.width - 4 * GAP, height: 2 * ROW };
    return layOut(
      row,
      some.map(([reaction, label]) => ({ label, icon: reaction, action: { kind: "send", message: { type: "react", reaction } } as const })),
    );
  });
}
