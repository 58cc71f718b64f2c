/** Which sides of head and body were seen for how long, and which turn would add most. */

import { SIDES, sideShown, type Side } from "../landmarks/turn";

export type Part = "head" | "body";
/** ms of each side. */
export type SidesSeen = Record<Part, Record<Side, number>>;

/** Seen for so long, a side is known. */
export const SIDE_MS = 600;

export interface Hint {
  part: Part;
  side: Side;
  words: string;
}

/** The first that is missing most; a face counts most, and what others meet least, least. */
const HINTS: readonly (Hint & { worth: number })[] = [
  { part: "head", side: "front", worth: 5, words: "Look straight at the camera." },
  { part: "head", side: "right", worth: 4, words: "Turn your head to the left." },
  { part: "head", side: "left", worth: 4, words: "Turn your head to the right." },
  { part: "body", side: "front", worth: 3, words: "Face the camera from farther away." },
  { part: "body", side: "right", worth: 2, words: "Turn your whole body to the left." },
  { part: "body", side: "left", worth: 2, words: "Turn your whole body to the right." },
  { part: "body", side: "back", worth: 1.5, words: "Turn your back to the camera." },
  { part: "head", side: "back", worth: 1, words: "Turn the back of your head to the camera." },
];

export function nothingSeen(): SidesSeen {
  return { head: { front: 0, left: 0, back: 0, right: 0 }, body: { front: 0, left: 0, back: 0, right: 0 } };
}

/** `seen` and `ms` more of what parts turned by so many degrees show; null: not in the picture. */
export function withTurn(seen: SidesSeen, turn: Record<Part, number | null>, ms: number): SidesSeen {
  const more = (part: Part): Record<Side, number> => {
    const deg = turn[part];
    if (deg === null) return seen[part];
    const side = sideShown(deg);
    return { ...seen[part], [side]: seen[part][side] + ms };
  };
  return { head: more("head"), body: more("body") };
}

export function together(several: readonly SidesSeen[]): SidesSeen {
  const sum = nothingSeen();
  for (const seen of several) for (const part of ["head", "body"] as const) for (const side of SIDES) sum[part][side] += seen[part][side];
  return sum;
}

/** How well a side is known, 0 to 1. */
export function shareSeen(seen: SidesSeen, part: Part, side: Side): number {
  return Math.min(1, seen[part][side] / SIDE_MS);
}

/** Of the body alone: how far once around is, 0 to 1. */
export function shareAround(seen: SidesSeen): number {
  return SIDES.reduce((sum, side) => sum + shareSeen(seen, "body", side), 0) / SIDES.length;
}

/** The turn that would help most; null where every side is known. */
export function mostHelpful(seen: SidesSeen): Hint | null {
  const gains = HINTS.map(({ part, side, worth }) => worth * (1 - shareSeen(seen, part, side)));
  const most = Math.max(...gains);
  return most > 0 ? (HINTS[gains.indexOf(most)] ?? null) : null;
}

/** "Seen of your head: front and left. Of your body: front." */
export function seenInWords(seen: SidesSeen): string {
  const known = (part: Part): string => SIDES.filter((side) => shareSeen(seen, part, side) === 1).join(", ") || "nothing yet";
  return `Seen of your head: ${known("head")}. Of your body: ${known("body")}.`;
}
