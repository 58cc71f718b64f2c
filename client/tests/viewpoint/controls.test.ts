// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { attachControls } from "../../src/viewpoint/controls";
import { Sway } from "../../src/viewpoint/sway";
import { Viewpoint, type Orbit } from "../../src/viewpoint/viewpoint";

const HOME: Orbit = { target: [0, 1, 0], azimuthRad: 0, elevationRad: 0.1, distanceM: 4 };

let detach: () => void = () => undefined;

/** A viewport of 500 px, with controls on a viewpoint that moves at once. */
function setUp(inertia = false) {
  const viewport = document.createElement("main");
  Object.defineProperty(viewport, "clientHeight", { value: 500 });
  viewport.setPointerCapture = vi.fn();
  document.body.replaceChildren(viewport);
  const viewpoint = new Viewpoint(HOME, inertia);
  const onUse = vi.fn();
  detach = attachControls(viewport, viewpoint, onUse);
  const pointer = (kind: string, init: PointerEventInit & { on?: Element } = {}): void => {
    (init.on ?? viewport).dispatchEvent(new PointerEvent(kind, { bubbles: true, pointerId: 1, buttons: 1, ...init }));
  };
  const drag = (dx: number, dy: number, init: PointerEventInit = {}): void => {
    pointer("pointerdown", { clientX: 100, clientY: 100, ...init });
    pointer("pointermove", { clientX: 100 + dx, clientY: 100 + dy, ...init });
    viewpoint.step(0.016);
  };
  const key = (kind: string, code: string, init: KeyboardEventInit = {}, on: EventTarget = viewport): KeyboardEvent => {
    const event = new KeyboardEvent(kind, { code, key: code, bubbles: true, cancelable: true, ...init });
    on.dispatchEvent(event);
    return event;
  };
  /** What a tenth of a second of the held keys changes. */
  const run = (): Orbit => (viewpoint.step(0.1), viewpoint.orbit);
  return { viewport, viewpoint, onUse, pointer, drag, key, run };
}

beforeEach(() => {
  vi.useFakeTimers();
});
afterEach(() => {
  detach();
  vi.useRealTimers();
});

describe("pointers", () => {
  it("turn the view as it is dragged, and stop once they are lifted", () => {
    const { viewpoint, drag, pointer, onUse } = setUp();
    drag(100, 0);
    expect(viewpoint.orbit.azimuthRad).toBeCloseTo(-0.65, 5);
    expect(onUse).toHaveBeenCalledTimes(1);
    pointer("pointerup");
    pointer("pointermove", { clientX: 400 });
    viewpoint.step(0.016);
    expect(viewpoint.orbit.azimuthRad).toBeCloseTo(-0.65, 5);
  });

  it("pan with Shift or the right button", () => {
    for (const init of [{ shiftKey: true }, { buttons: 2 }]) {
      const { viewpoint, drag } = setUp();
      drag(50, 25, init);
      const [x, y] = viewpoint.orbit.target;
      const metres = (px: number): number => (px * 4 * 0.62) / 500;
      expect([x, y]).toEqual([expect.closeTo(-metres(50), 5), expect.closeTo(1 + metres(25), 5)]);
      expect(viewpoint.orbit.azimuthRad).toBe(0);
      detach();
    }
  });

  it("zoom as two of them spread, and do not turn", () => {
    const { viewpoint, pointer } = setUp();
    pointer("pointerdown", { clientX: 100, clientY: 100 });
    pointer("pointerdown", { clientX: 200, clientY: 100, pointerId: 2 });
    pointer("pointermove", { clientX: 300, clientY: 100, pointerId: 2 });
    viewpoint.step(0.016);
    expect(viewpoint.orbit.distanceM).toBeCloseTo(2, 5);
    expect(viewpoint.orbit.azimuthRad).toBe(0);
  });

  it("go on turning after a quick drag, and not after a rest", () => {
    const moved = (restMs: number): number => {
      const { viewpoint, pointer } = setUp(true);
      pointer("pointerdown", { clientX: 100 });
      vi.advanceTimersByTime(16);
      pointer("pointermove", { clientX: 140 });
      vi.advanceTimersByTime(restMs);
      pointer("pointerup");
      for (let n = 0; n < 200; n++) viewpoint.step(0.05);
      detach();
      return viewpoint.orbit.azimuthRad;
    };
    expect(moved(200)).toBeCloseTo(-40 * 0.0065, 3);
    expect(moved(10)).toBeLessThan(-40 * 0.0065 - 0.1);
  });

  it.each(["button", "input"])("that press a %s leave the view alone", (tag) => {
    const { viewport, viewpoint, pointer, onUse } = setUp();
    const pressed = viewport.appendChild(document.createElement(tag));
    pointer("pointerdown", { clientX: 100, on: pressed });
    pointer("pointermove", { clientX: 300 });
    viewpoint.step(0.016);
    expect(viewpoint.orbit).toBe(HOME);
    expect(onUse).not.toHaveBeenCalled();
  });
});

describe("the wheel", () => {
  const wheel = (init: WheelEventInit): { distanceM: number; prevented: boolean } => {
    const { viewport, viewpoint } = setUp();
    const event = new WheelEvent("wheel", { bubbles: true, cancelable: true, ...init });
    // what happy-dom leaves out of a wheel's event
    Object.defineProperty(event, "ctrlKey", { value: init.ctrlKey ?? false });
    viewport.dispatchEvent(event);
    viewpoint.step(0.016);
    detach();
    return { distanceM: viewpoint.orbit.distanceM, prevented: event.defaultPrevented };
  };

  it("zooms, finer by a trackpad's pinch, and by lines as by pixels", () => {
    expect(wheel({ deltaY: 100 }).distanceM).toBeCloseTo(4 * Math.exp(0.14), 5);
    expect(wheel({ deltaY: -10, ctrlKey: true }).distanceM).toBeCloseTo(4 * Math.exp(-0.084), 5);
    expect(wheel({ deltaY: 2, deltaMode: WheelEvent.DOM_DELTA_LINE }).distanceM).toBeCloseTo(4 * Math.exp(32 * 0.0014), 5);
  });

  it("does not scroll the page", () => {
    expect(wheel({ deltaY: 1 }).prevented).toBe(true);
  });
});

describe("the keyboard", () => {
  it("walks while a key is held, faster with Shift, and stops when it is let go of", () => {
    const walked = (init: KeyboardEventInit): number => {
      const { key, run } = setUp();
      key("keydown", "KeyW", init);
      const { target } = run();
      key("keyup", "KeyW");
      expect(run().target[2]).toBe(target[2]);
      detach();
      return -target[2];
    };
    expect(walked({})).toBeCloseTo(0.14, 5);
    expect(walked({ shiftKey: true })).toBeCloseTo(0.35, 5);
  });

  it("has keys for each direction, turning and zooming", () => {
    const after = (code: string): Orbit => {
      const { key, run } = setUp();
      key("keydown", code);
      const orbit = run();
      detach();
      return orbit;
    };
    expect(after("ArrowDown").target[2]).toBeGreaterThan(0);
    expect(after("KeyD").target[0]).toBeGreaterThan(0);
    expect(after("ArrowLeft").target[0]).toBeLessThan(0);
    expect(after("KeyE").azimuthRad).toBeGreaterThan(0);
    expect(after("KeyQ").azimuthRad).toBeLessThan(0);
    expect(after("Equal").distanceM).toBeLessThan(4);
    expect(after("NumpadSubtract").distanceM).toBeGreaterThan(4);
  });

  it("stands still where opposite keys are held", () => {
    const { key, run } = setUp();
    key("keydown", "KeyW");
    key("keydown", "ArrowDown");
    expect(run().target[2]).toBe(0);
  });

  it("resets the view by R and by a double click", () => {
    const { viewport, viewpoint, key } = setUp();
    for (const reset of [() => key("keydown", "KeyR"), () => viewport.dispatchEvent(new MouseEvent("dblclick"))]) {
      viewpoint.turn(1, 0);
      viewpoint.step(0.016);
      reset();
      viewpoint.step(0.016);
      expect(viewpoint.orbit.azimuthRad).toBeCloseTo(0, 5);
    }
  });

  it("is left to whoever types, and to the browser's own shortcuts", () => {
    const { viewport, key, run, onUse } = setUp();
    const field = viewport.appendChild(document.createElement("input"));
    expect(key("keydown", "KeyW", {}, field).defaultPrevented).toBe(false);
    expect(key("keydown", "KeyW", { ctrlKey: true }).defaultPrevented).toBe(false);
    expect(key("keydown", "KeyZ").defaultPrevented).toBe(false);
    expect(run().target[2]).toBe(0);
    expect(onUse).not.toHaveBeenCalled();
  });

  it("lets go of every key when the window loses the focus, and when the controls are detached", () => {
    for (const end of [() => window.dispatchEvent(new Event("blur")), () => detach()]) {
      const { key, run } = setUp();
      key("keydown", "KeyD");
      run();
      end();
      const { target } = run();
      expect(run().target).toEqual(target);
      detach();
    }
  });
});

describe("Sway", () => {
  it("drifts to both sides and comes back, without a leap after a pause", () => {
    const sway = new Sway();
    let at = 0;
    const way = Array.from({ length: 18 * 20 }, () => (at += sway.step(0.05)));
    expect(Math.max(...way)).toBeCloseTo(0.45, 2);
    expect(Math.min(...way)).toBeCloseTo(-0.45, 2);
    expect(at).toBeCloseTo(0, 5);
    expect(Math.abs(sway.step(600))).toBeLessThan(0.02);
  });
});
