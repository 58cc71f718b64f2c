/** What a headset's controllers and hands point at, press, and turn by. */

import type { Vec3 } from "../viewpoint/geometry";
import type { ViewerRig } from "./rig";
import { itemAt, MENU_PX, type MenuItem } from "./menu";
import { isSameItem } from "./paint";
import { floorHit, quadHit, rayOf, type Quad, type Ray } from "./space";

/** What lies under a ray: a button, or a place on the floor to step to. */
export type Target = { kind: "item"; item: MenuItem } | { kind: "floor"; at: Vec3 };

export interface Aim {
  /** In the room. */
  ray: Ray;
  target: Target | null;
  /** Where the ray ends, m along it. */
  endM: number;
  /** What was let go of just now where it had been pressed. */
  pressed: Target | null;
  /** A push of the stick, just now: 1 to the right, -1 to the left. */
  turned: -1 | 0 | 1;
}

const MAX_RAY_M = 7;
/** A stick counts as pushed beyond the first, and as let go of below the second. */
const STICK_PUSHED = 0.6;
const STICK_RELEASED = 0.3;
/** Place of a thumbstick's x in a gamepad of the WebXR standard mapping; a touchpad's comes first. */
const STICK_X = 2;

interface PointerState {
  down: boolean;
  released: boolean;
  began: Target | null;
  stick: boolean;
}

export class Pointers {
  private readonly states = new Map<XRInputSource, PointerState>();

  constructor(private readonly session: XRSession) {
    session.addEventListener("selectstart", ({ inputSource }) => {
      Object.assign(this.of(inputSource), { down: true, began: null });
    });
    session.addEventListener("selectend", ({ inputSource }) => {
      const held = this.of(inputSource);
      held.released = held.down;
      held.down = false;
    });
    // what is laid aside while pressed was never let go of
    session.addEventListener("inputsourceschange", ({ removed }) => removed.forEach((one) => this.states.delete(one)));
  }

  /** Where each points now; `menu` is the board of buttons in the room, if there is one. */
  aims(frame: XRFrame, space: XRSpace, footing: ViewerRig, menu: { quad: Quad; items: readonly MenuItem[] } | null): Aim[] {
    const aims: Aim[] = [];
    for (const source of this.session.inputSources) {
      const pose = frame.getPose(source.targetRaySpace, space);
      if (!pose) continue;
      const ray = footing.rayToRoom(rayOf(pose.transform.matrix));
      const { over: target, endM } = hitTest(ray, menu);
      const held = this.of(source);
      aims.push({ ray, target, endM, pressed: this.pressOf(held, target), turned: this.snapTurnOf(held, source) });
    }
    return aims;
  }

  private pressOf(held: PointerState, over: Target | null): Target | null {
    if (held.down) held.began ??= over;
    if (!held.released) return null;
    held.released = false;
    const { began } = held;
    held.began = null;
    // a press counts where it ends as it began; on the floor one may still choose the place
    if (began?.kind === "item") return over?.kind === "item" && isSameItem(over.item, began.item) ? over : null;
    return began?.kind === over?.kind ? over : null;
  }

  private snapTurnOf(held: PointerState, { gamepad }: XRInputSource): -1 | 0 | 1 {
    const x = gamepad?.axes[STICK_X] ?? 0;
    if (held.stick) {
      held.stick = Math.abs(x) > STICK_RELEASED;
      return 0;
    }
    held.stick = Math.abs(x) > STICK_PUSHED;
    return held.stick ? (x > 0 ? 1 : -1) : 0;
  }

  private of(source: XRInputSource): PointerState {
    const known = this.states.get(source) ?? { down: false, released: false, began: null, stick: false };
    this.states.set(source, known);
    return known;
  }
}

/** What a ray meets first. */
export function hitTest(
  ray: Ray,
  menu: { quad: Quad; items: readonly MenuItem[] } | null,
): { over: Target | null; endM: number } {
  const hit = menu && quadHit(ray, menu.quad);
  const [x, y] = [(hit?.u ?? 0) * MENU_PX.width, (hit?.v ?? 0) * MENU_PX.height];
  const on = hit && menu.items.some((item) => x >= item.x && y >= item.y && x < item.x + item.width && y < item.y + item.height);
  if (hit && on) {
    const item = itemAt(menu.items, x, y);
    return { over: item && { kind: "item", item }, endM: hit.distanceM };
  }
  const at = floorHit(ray, MAX_RAY_M);
  if (!at) return { over: null, endM: MAX_RAY_M };
  return { over: { kind: "floor", at }, endM: Math.hypot(at[0] - ray.from[0], ray.from[1], at[2] - ray.from[2]) };
}
