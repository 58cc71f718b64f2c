/** Somebody from four sides, filled as far as each side of head and body was seen; and what would help most. */

import { mostHelpful, seenInWords, shareSeen, type Part, type SidesSeen } from "../enrolment/sidesSeen";
import { SIDES, type Side } from "../landmarks/turn";
import { h, svg } from "./dom";

const WIDE = "M-15 47a15 15 0 0 1 30 0v23a3.4 3.4 0 0 1-6.8 0V50v56a4 4 0 0 1-7.7 0V77h-1v29a4 4 0 0 1-7.7 0V50v20a3.4 3.4 0 0 1-6.8 0z";
const SLIM = "M-8 47a8 15 0 0 1 16 0v25a5 5 0 0 1-3 4.5V106a4.5 4.5 0 0 1-9 0V76.5a5 5 0 0 1-4-4.5z";
const EYES = '<path class="seen-face" d="M-3.2 15.5v1.5M3.2 15.5v1.5"/>';
/** In a mirror, as the preview is: who shows their left looks to the right of it. */
const NOSE: Partial<Record<Side, string>> = { left: "M7.5 14l5 4.5l-5 1z", right: "M-7.5 14l-5 4.5l5 1z" };
const UNSEEN_OPACITY = 0.16;

export interface SeenFigure {
  element: HTMLElement;
  show(seen: SidesSeen): void;
}

export function seenFigure(): SeenFigure {
  const picture = svg(
    '<svg class="seen-figure" viewBox="0 0 240 130" fill="currentColor" role="img">' +
      SIDES.map((side, i) => person(side, 30 + 60 * i)).join("") +
      "</svg>",
  );
  const hint = h("p", { className: "seen-hint", testId: "guide-hint" });
  const element = h("section", { className: "seen", attributes: { "aria-label": "What has been seen of you" } }, h("h3", {}, "Seen of you"), picture, hint);
  const show = (seen: SidesSeen): void => {
    for (const part of ["head", "body"] as const) for (const side of SIDES) fill(picture, part, side, shareSeen(seen, part, side));
    picture.setAttribute("aria-label", seenInWords(seen));
    const most = mostHelpful(seen);
    hint.textContent = most ? `Would help most: ${lowerFirst(most.words)}` : "Every side has been seen.";
  };
  return { element, show };
}

function person(side: Side, x: number): string {
  const isWide = side === "front" || side === "back";
  const nose = NOSE[side];
  return (
    `<g transform="translate(${x} 0)"><path data-part="body-${side}" d="${isWide ? WIDE : SLIM}"/>` +
    `<g data-part="head-${side}"><circle cy="17" r="9"/>${nose ? `<path d="${nose}"/>` : ""}</g>${side === "front" ? EYES : ""}` +
    `<text class="seen-side" y="126" text-anchor="middle">${side}</text></g>`
  );
}

function fill(picture: SVGElement, part: Part, side: Side, share: number): void {
  const shape = picture.querySelector(`[data-part="${part}-${side}"]`);
  shape?.setAttribute("opacity", String(UNSEEN_OPACITY + (1 - UNSEEN_OPACITY) * share));
  shape?.toggleAttribute("data-seen", share === 1);
}

function lowerFirst(text: string): string {
  return text.charAt(0).toLowerCase() + text.slice(1);
}
