// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { LiveView } from "../../src/drawing/live";
import type { MeetingSession } from "../../src/meeting/session";
import { INITIAL_STATE } from "../../src/meeting/state";
import { enterVrButton } from "../../src/xr/enterButton";
import { FRONT } from "../viewpoint/front";
import { eventually } from "../waiting";

class FakeSession extends EventTarget {
  inputSources = [];
  ended = false;
  requestReferenceSpace = async (): Promise<EventTarget> => new EventTarget();
  updateRenderState = (): void => undefined;
  requestAnimationFrame = (): number => 1;
  async end(): Promise<void> {
    if (this.ended) throw new DOMException("over", "InvalidStateError");
    this.ended = true;
    this.dispatchEvent(new Event("end"));
  }
}

/** As much of WebGL as making textures and programs takes. */
function fakeGl(): WebGL2RenderingContext {
  const answer: Record<string, unknown> = { getProgramParameter: true, getAttachedShaders: [] };
  return new Proxy({}, { get: (_, name) => () => (String(name) in answer ? answer[String(name)] : {}) }) as WebGL2RenderingContext;
}

let supported = true;
let system: EventTarget & { requestSession?: unknown; isSessionSupported?: unknown };

function setUp({ graphics = true, seat = async (): Promise<object> => ({ seat: 1 }) } = {}) {
  const session = new FakeSession();
  const requestSession = vi.fn(async () => session);
  system = Object.assign(new EventTarget(), { requestSession, isSessionSupported: async () => supported });
  vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { xr: system }));
  const visits: string[] = [];
  const live = {
    meeting: { performers: [], viewpoint: FRONT },
    beginHeadset: () => (visits.push("begin"), { room: { graphics: graphics ? fakeGl() : null, obstacle: "no WebGL2" } }),
    endHeadset: () => visits.push("end"),
  } as unknown as LiveView;
  const meetingSession = {
    state: INITIAL_STATE,
    connectionState: { kind: "open" },
    onReaction: () => undefined,
    subscribe: () => () => undefined,
    getSeat: seat,
  } as unknown as MeetingSession;
  const { element, close } = enterVrButton(live, meetingSession, { microphone: () => undefined, leave: () => undefined });
  document.body.append(element);
  const pressed = (): string | null => element.getAttribute("aria-pressed");
  return { button: element as HTMLButtonElement, close, session, requestSession, visits, pressed };
}

const offered = (button: HTMLElement): Promise<void> => eventually(() => expect(button.hidden).toBe(false));

beforeEach(() => {
  supported = true;
  document.body.innerHTML = '<div id="announcer"></div>';
  vi.stubGlobal("XRWebGLLayer", class {
    constructor({ ended }: FakeSession) {
      if (ended) throw new DOMException("the session has ended", "InvalidStateError");
    }
  });
  vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockReturnValue({ canvas: {} } as unknown as RenderingContext);
});
afterEach(() => {
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

describe("the button into a headset", () => {
  it("is there only where the browser has a headset, also one that is plugged in later", async () => {
    supported = false;
    const { button } = setUp();
    await new Promise((resolve) => setTimeout(resolve));
    expect(button.hidden).toBe(true);
    supported = true;
    system.dispatchEvent(new Event("devicechange"));
    await offered(button);
  });

  it("enters, and leaves again by the same press", async () => {
    const { button, session, visits, pressed } = setUp();
    await offered(button);
    button.click();
    await eventually(() => expect(pressed()).toBe("true"));
    expect(button.textContent).toBe("Leave VR");
    expect(visits).toEqual(["begin"]);
    button.click();
    await eventually(() => expect(pressed()).toBe("false"));
    expect([session.ended, visits]).toEqual([true, ["begin", "end"]]);
    expect(button.textContent).toBe("Enter VR");
  });

  it("says so where the headset is refused, and can be pressed again", async () => {
    const { button, requestSession, pressed } = setUp();
    requestSession.mockRejectedValueOnce(new DOMException("no", "NotAllowedError"));
    await offered(button);
    button.click();
    await eventually(() => expect(document.getElementById("announcer")?.textContent).toContain("could not be used"));
    await eventually(() => expect(button.disabled).toBe(false));
    button.click();
    await eventually(() => expect(pressed()).toBe("true"));
  });

  it("ends the headset's session where this device can't draw", async () => {
    const { button, session, visits } = setUp({ graphics: false });
    await offered(button);
    button.click();
    await eventually(() => expect(session.ended).toBe(true));
    expect(visits).toEqual(["begin", "end"]);
  });

  it("gives the picture back to the page where the headset is taken off on the way in", async () => {
    let arrive: (seat: object) => void = () => undefined;
    const { button, session, visits, pressed } = setUp({ seat: () => new Promise((resolve) => (arrive = resolve)) });
    await offered(button);
    button.click();
    await new Promise((resolve) => setTimeout(resolve, 20));
    await session.end();
    arrive({ seat: 1 });
    await eventually(() => expect(button.disabled).toBe(false));
    expect(visits).toEqual(["begin", "end"]);
    expect(pressed()).not.toBe("true");
  });

  it("takes nobody into a meeting that is left on the way in", async () => {
    let arrive: (seat: object) => void = () => undefined;
    const { button, close, session, visits } = setUp({ seat: () => new Promise((resolve) => (arrive = resolve)) });
    await offered(button);
    button.click();
    await new Promise((resolve) => setTimeout(resolve, 50));
    close();
    await eventually(() => expect(session.ended).toBe(true));
    arrive({ seat: 1 });
    await eventually(() => expect(button.disabled).toBe(false));
    expect(visits.filter((one) => one === "begin")).toHaveLength(visits.filter((one) => one === "end").length);
  });
});
