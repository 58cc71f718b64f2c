/** Mouse, touch and keyboard on the viewport, turned into moves of the viewpoint. */

import type { Viewpoint } from "./viewpoint";

const TURN_RAD_PER_PX = 0.0065;
const ZOOM_PER_WHEEL_PX = 0.0014;
const LINE_PX = 16;
/** Older than this, the last movement of a drag no longer counts as its speed. */
const FLING_MS = 80;

/** Every key that steers, by its place on the keyboard, so that WASD lies where it should. */
const KEYS: Record<string, readonly ["forward" | "right" | "turn" | "zoom", 1 | -1]> = {
  KeyW: ["forward", 1],
  ArrowUp: ["forward", 1],
  KeyS: ["forward", -1],
  ArrowDown: ["forward", -1],
  KeyD: ["right", 1],
  ArrowRight: ["right", 1],
  KeyA: ["right", -1],
  ArrowLeft: ["right", -1],
  KeyQ: ["turn", -1],
  KeyE: ["turn", 1],
  Equal: ["zoom", 1],
  NumpadAdd: ["zoom", 1],
  Minus: ["zoom", -1],
  NumpadSubtract: ["zoom", -1],
};
const RESET_KEYS = new Set(["KeyR", "Home"]);

interface PointerPosition {
  x: number;
  y: number;
}

/** Listen on `viewport` until the returned function is called. `onUse` hears of the first of each move. */
export function attachControls(viewport: HTMLElement, viewpoint: Viewpoint, onUse: () => void): () => void {
  const ending = new AbortController();
  const { signal } = ending;
  pointers(viewport, viewpoint, onUse, signal);
  viewport.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const px = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? LINE_PX : 1);
      // a pinch on a trackpad arrives as a wheel with ctrl, in finer steps
      viewpoint.zoom(Math.exp(px * ZOOM_PER_WHEEL_PX * (event.ctrlKey ? 6 : 1)));
      onUse();
    },
    { passive: false, signal },
  );
  viewport.addEventListener("dblclick", () => viewpoint.reset(), { signal });
  keyboard(viewpoint, onUse, signal);
  return () => ending.abort();
}

function pointers(viewport: HTMLElement, view: Viewpoint, onUse: () => void, signal: AbortSignal): void {
  const pointersDown = new Map<number, PointerPosition>();
  let speed = { x: 0, y: 0, atMs: 0 };

  const metresPerPx = (): number => (view.orbit.distanceM * 0.62) / Math.max(viewport.clientHeight, 1);
  const pan = (dx: number, dy: number): void =>
    view.pan(-dx * metresPerPx(), dy * metresPerPx());

  viewport.addEventListener(
    "pointerdown",
    (event) => {
      if ((event.target as Element).closest("button, a, label, input")) return;
      viewport.setPointerCapture(event.pointerId);
      pointersDown.set(event.pointerId, { x: event.clientX, y: event.clientY });
      speed = { x: 0, y: 0, atMs: 0 };
      onUse();
    },
    { signal },
  );
  viewport.addEventListener(
    "pointermove",
    (event) => {
      const before = pointersDown.get(event.pointerId);
      if (!before) return;
      const after = { x: event.clientX, y: event.clientY };
      const [dx, dy] = [after.x - before.x, after.y - before.y];
      pointersDown.set(event.pointerId, after);
      const other = [...pointersDown].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const [was, is] = [span(before, other), span(after, other)];
        if (was > 1 && is > 1) view.zoom(was / is);
        pan(dx / 2, dy / 2);
      } else if (event.buttons & 6 || event.shiftKey) {
        pan(dx, dy);
      } else {
        view.turn(-dx * TURN_RAD_PER_PX, dy * TURN_RAD_PER_PX);
        const ms = Math.max(1, event.timeStamp - (speed.atMs || event.timeStamp - 16));
        speed = { x: (dx / ms) * 1000, y: (dy / ms) * 1000, atMs: event.timeStamp };
      }
    },
    { signal },
  );
  const lift = (event: PointerEvent): void => {
    if (!pointersDown.delete(event.pointerId) || pointersDown.size > 0) return;
    if (event.timeStamp - speed.atMs < FLING_MS) {
      view.fling(-speed.x * TURN_RAD_PER_PX, speed.y * TURN_RAD_PER_PX);
    }
  };
  viewport.addEventListener("pointerup", lift, { signal });
  viewport.addEventListener("pointercancel", lift, { signal });
  // the right button slides the view; its menu would cover it
  viewport.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
}

function keyboard(view: Viewpoint, onUse: () => void, signal: AbortSignal): void {
  const held = new Set<string>();
  let run = false;
  const steer = (): void => {
    const steering = { forward: 0, right: 0, turn: 0, zoom: 0, run };
    for (const code of held) {
      const [way, sign] = KEYS[code] ?? ["turn", 0];
      steering[way] = Math.max(-1, Math.min(1, steering[way] + sign));
    }
    view.steer(steering);
  };
  addEventListener(
    "keydown",
    (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
      run = event.shiftKey;
      if (RESET_KEYS.has(event.code)) view.reset();
      else if (event.code in KEYS) held.add(event.code);
      else if (event.key !== "Shift") return;
      if (event.key !== "Shift") {
        event.preventDefault();
        onUse();
      }
      steer();
    },
    { signal },
  );
  addEventListener(
    "keyup",
    (event) => {
      held.delete(event.code);
      run = event.shiftKey;
      steer();
    },
    { signal },
  );
  const releaseKeys = (): void => {
    held.clear();
    run = false;
    steer();
  };
  addEventListener("blur", releaseKeys, { signal });
  signal.addEventListener("abort", releaseKeys);
}

function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.closest("input, textarea, select") !== null;
}

function span(a: PointerPosition, b: PointerPosition): number {
  return Math.hypot(a.x - b.x, a.y - b.y);
}
