// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Api } from "../../src/api/api";
import { Problem } from "../../src/api/problem";
import type { Performer } from "../../src/api/types";
import type { LiveView } from "../../src/drawing/live";
import type { LiveState } from "../../src/drawing/liveState";
import type { RenderStatus } from "../../src/splats/renderMode";
import { meetingTools } from "../../src/views/meetingTools";
import { meetingView } from "../../src/views/meetingView";
import { Viewpoint, homeOrbit } from "../../src/viewpoint/viewpoint";
import { fakeFetch, json, member, tokenStore } from "../fakes";
import { BO, HOST, find, inside, press } from "./inside";
import { FRONT } from "../viewpoint/front";

const ADA = { id: "p", name: "Ada", model_id: "m", position: [1, 0, 2] } as unknown as Performer;

/** As much of a live view as the page around it needs. */
function fakeLive() {
  const { request } = fakeFetch(() => json({ items: [] }));
  return {
    api: new Api(tokenStore("guest"), request),
    meeting: { name: "Monday", join_url: "http://elsewhere/?meeting=m#token=t", performers: [ADA] },
    video: document.createElement("video"),
    canvas: document.createElement("canvas"),
    viewpoint: new Viewpoint(homeOrbit(FRONT, 1), false),
    state: { kind: "connecting" } as LiveState,
    onState: (_: LiveState): void => undefined,
    onStats: (_: object): void => undefined,
    onRenderStatus: (_: RenderStatus): void => undefined,
    onPerformers: (_: readonly Performer[]): void => undefined,
    onGone: (_: readonly Performer[]): void => undefined,
    lookAt: vi.fn(),
    setHideUnseen: vi.fn(),
    chooseRenderMode: vi.fn(),
    showScreen: vi.fn(),
    listener: { position: [0, 0, 0], wxyz: [1, 0, 0, 0] },
    headPosition: () => null,
    setVoiceDelays: () => undefined,
  };
}

let close: () => void = () => undefined;

function setUp() {
  const there = inside(() => json({ items: [] }));
  there.session.getSeat = () => new Promise(() => undefined); // no voice connection here
  const tools = meetingTools(there.api, there.session);
  const live = fakeLive();
  const hooks = { onLeave: vi.fn(), onRetry: vi.fn() };
  const headset = { element: document.createElement("button"), close: vi.fn() };
  const view = meetingView(live as unknown as LiveView, tools, headset, hooks);
  close = view.close;
  document.body.append(view.element);
  const labelled = (label: string): HTMLElement => {
    const found = [...view.element.querySelectorAll<HTMLElement>("button")].find((one) => one.textContent === label);
    if (!found) throw new Error(`no button “${label}”`);
    return found;
  };
  return { ...there, element: view.element, live, hooks, headset, labelled };
}

beforeEach(() => {
  vi.useFakeTimers();
  document.body.innerHTML = '<div id="announcer"></div>';
  vi.stubGlobal("AudioContext", class {
    createMediaStreamDestination = (): object => ({ stream: null });
    listener = new Proxy({}, { get: () => ({ setTargetAtTime: () => undefined }) });
    close = async (): Promise<void> => undefined;
  });
});
afterEach(() => {
  close();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the meeting", () => {
  it("says that a machine made what is seen", () => {
    const { element } = setUp();
    expect(element.querySelector(".viewport-title")?.textContent).toBe("MondayComputer-generated");
  });

  it("tells what one waits for, until there is a picture", () => {
    const { element, live } = setUp();
    expect(find(element, "waiting").textContent).toContain("Connecting");
    live.onState({ kind: "preparing", firstStart: true });
    expect(find(element, "waiting").textContent).toContain("The server is starting up");
    live.onState({ kind: "live" });
    expect(element.querySelector("[data-testid=waiting]")).toBeNull();
    live.onState({ kind: "audio-only" });
    expect(element.classList.contains("audio-only")).toBe(true);
    live.onState({ kind: "live" });
    expect(document.getElementById("announcer")?.lastElementChild?.textContent).toBe("Video is back");
  });

  it("offers a way on where the connection is refused", () => {
    const { element, live, hooks, labelled } = setUp();
    live.onState({ kind: "refused", problem: new Problem("The meeting is full", "Twelve are in it.", 409) });
    expect(find(element, "error").textContent).toContain("The meeting is full");
    labelled("Try again").click();
    labelled("Back to the start").click();
    expect([hooks.onRetry.mock.calls.length, hooks.onLeave.mock.calls.length]).toEqual([1, 1]);
  });

  it("says who is no longer shown, and to oneself what to do about it", () => {
    const { element, live } = setUp();
    live.onGone([ADA, { ...ADA, id: "mine", owner: "own" }]);
    expect(element.querySelector(".previews")?.textContent).toContain("Ada is no longer shown");
    expect(element.querySelector(".previews")?.textContent).toContain("See “Your consent” under More.");
  });

  it("looks at whom one presses, and back", () => {
    const { live, labelled } = setUp();
    const home = live.viewpoint.orbit;
    labelled("Ada").click();
    expect(live.lookAt).toHaveBeenCalledWith(ADA);
    live.viewpoint.zoom(2);
    live.viewpoint.step(0.1);
    labelled("Reset view").click();
    live.viewpoint.step(0.1);
    expect(live.viewpoint.orbit.distanceM).toBeCloseTo(home.distanceM, 5);
  });

  it("hides unseen parts, and shows them again", () => {
    const { element, live } = setUp();
    press(element, "show-unseen");
    press(element, "show-unseen");
    expect(live.setHideUnseen.mock.calls).toEqual([[false], [true]]);
    expect(find(element, "show-unseen").getAttribute("aria-pressed")).toBe("false");
  });

  it("lets one choose who renders, but for a device that can't", () => {
    const { element, live } = setUp();
    const select = find<HTMLSelectElement>(element, "render-mode");
    live.onRenderStatus({ setting: "automatic", mode: "local", obstacle: null });
    expect([select.value, element.classList.contains("renders-locally")]).toEqual(["automatic", true]);
    select.value = "server";
    select.dispatchEvent(new Event("change"));
    expect(live.chooseRenderMode).toHaveBeenCalledWith("server");
    live.onRenderStatus({ setting: "server", mode: "server", obstacle: "no WebGL2" });
    expect([...select.options].map(({ disabled }) => disabled)).toEqual([false, true, false]);
    expect(select.closest("label")?.title).toBe("no WebGL2");
  });

  it("copies an invitation to this page's own address, and shows the link where it may not copy", async () => {
    const copied: string[] = [];
    const clipboard = { writeText: async (text: string) => void copied.push(text) };
    vi.stubGlobal("navigator", Object.create(navigator, { clipboard: { value: clipboard } }));
    const { live, labelled } = setUp();
    const link = `${location.origin}/?meeting=m#token=t`;
    const button = labelled("Copy invite link");
    button.click();
    await vi.advanceTimersByTimeAsync(10);
    expect([copied, button.textContent]).toEqual([[link], "Copied"]);
    await vi.advanceTimersByTimeAsync(2000);
    expect(button.textContent).toBe("Copy invite link");
    const shown = vi.fn();
    vi.stubGlobal("prompt", shown);
    clipboard.writeText = () => Promise.reject(new DOMException("no", "NotAllowedError"));
    button.click();
    await vi.advanceTimersByTimeAsync(10);
    expect(shown).toHaveBeenCalledWith(expect.any(String), link);
    live.meeting.join_url = "http://elsewhere/?meeting=m#token=renewed";
    button.click();
    await vi.advanceTimersByTimeAsync(10);
    expect(shown).toHaveBeenLastCalledWith(expect.any(String), link.replace("=t", "=renewed"));
  });

  it("counts people and unread messages on their buttons, until they are read", () => {
    const { element, hear, roster } = setUp();
    roster({ members: [HOST, BO, member({ id: "w", name: "Wim", admission: "waiting" })] });
    expect(find(element, "open-people").textContent).toContain("2 here, 1 waiting");
    hear({ type: "said", number: 1, participant_id: "b", name: "Bo", text: "Hello", at: "2026-01-01T00:00:00Z" });
    expect(find(element, "open-chat").textContent).toContain("1 new");
    expect(element.querySelector(".previews")?.textContent).toBe("Bo Hello");
    press(element, "open-chat");
    expect(find(element, "open-chat").textContent).not.toContain("new");
    expect(element.querySelector(".previews")?.textContent).toBe("");
  });

  it("folds the help away once somebody has found out how it goes", () => {
    const { element } = setUp();
    const help = element.querySelector("#controls-help");
    element.dispatchEvent(new WheelEvent("wheel", { deltaY: 1, cancelable: true }));
    expect(help?.classList.contains("away")).toBe(false);
    vi.advanceTimersByTime(6000);
    expect(help?.classList.contains("away")).toBe(true);
    [...element.querySelectorAll("button")].find(({ textContent }) => textContent === "Controls")?.click();
    expect(help?.classList.contains("away")).toBe(false);
  });

  it("says only how to look round where the window is narrow, and the rest when asked", () => {
    vi.stubGlobal("matchMedia", (query: string) => ({ matches: query === "(max-width: 860px)" }));
    const { element } = setUp();
    const help = element.querySelector("#controls-help");
    const toggle = [...element.querySelectorAll("button")].find(({ textContent }) => textContent === "Controls");
    const shown = (): (string | null)[] => [...(help?.children ?? [])].filter(({ className }) => className === "").map(({ textContent }) => textContent);
    expect([shown(), toggle?.getAttribute("aria-expanded")]).toEqual([["Draglook around", "Scrollzoom"], "false"]);
    toggle?.click();
    expect([shown().length, toggle?.getAttribute("aria-expanded")]).toEqual([5, "true"]);
    toggle?.click();
    expect([help?.classList.contains("away"), toggle?.getAttribute("aria-expanded")]).toEqual([true, "false"]);
    vi.unstubAllGlobals();
  });
});
