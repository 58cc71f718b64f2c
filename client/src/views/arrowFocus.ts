/**
 * Arrow keys among buttons, for a remote control: Enter leads from the picture to the buttons, the
 * arrows from one to the nearest in their direction, Escape back to the picture, where they steer.
 */

export type Arrow = "ArrowUp" | "ArrowDown" | "ArrowLeft" | "ArrowRight";

export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

const FOCUSABLE = "button:not(:disabled), a[href], input:not(:disabled, [type=radio]), [type=radio]:checked, select, summary";
/** Keys that these use themselves. */
const TYPING = "textarea, select, input:not([type=checkbox], [type=file])";
/** Aside counts more than ahead: what lies in line comes first. */
const ASIDE = 2.5;

/** The index of the box nearest to `from` towards `arrow`; -1 where none lies there. */
export function nearest(from: Box, boxes: readonly Box[], arrow: Arrow): number {
  let best = -1;
  let least = Infinity;
  const across = arrow === "ArrowLeft" || arrow === "ArrowRight";
  const sign = arrow === "ArrowRight" || arrow === "ArrowDown" ? 1 : -1;
  boxes.forEach((box, index) => {
    const dx = box.x + box.width / 2 - from.x - from.width / 2;
    const dy = box.y + box.height / 2 - from.y - from.height / 2;
    const ahead = sign * (across ? dx : dy);
    const aside = Math.abs(across ? dy : dx);
    const cost = ahead + ASIDE * aside;
    if (ahead > 1 && cost < least) [best, least] = [index, cost];
  });
  return best;
}

/** Listen on `viewport` until the returned function is called; `first` is where Enter leads. */
export function moveFocusByArrows(viewport: HTMLElement, first: () => HTMLElement): () => void {
  const onKey = (event: KeyboardEvent): void => {
    const at = document.activeElement;
    if (!(at instanceof HTMLElement) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (at === viewport) {
      if (event.key === "Enter") moveFocus(event, first());
      return;
    }
    // who presses with a mouse goes on steering
    if (!at.matches(":focus-visible") || at.matches(TYPING)) return;
    if (event.key === "Escape" && !at.closest(".panel, .reaction-menu")) return moveFocus(event, viewport);
    if (!event.key.startsWith("Arrow")) return;
    const others = [...viewport.querySelectorAll<HTMLElement>(FOCUSABLE)].filter(
      (one) => one !== at && one.checkVisibility({ visibilityProperty: true }),
    );
    const boxes = others.map((one) => one.getBoundingClientRect());
    const next = others[nearest(at.getBoundingClientRect(), boxes, event.key as Arrow)];
    moveFocus(event, next ?? at);
  };
  viewport.addEventListener("keydown", onKey, true);
  return () => viewport.removeEventListener("keydown", onKey, true);
}

function moveFocus(event: KeyboardEvent, next: HTMLElement): void {
  event.preventDefault();
  event.stopPropagation();
  next.focus();
}
