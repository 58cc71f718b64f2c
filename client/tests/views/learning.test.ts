// @vitest-environment happy-dom
import { beforeEach, describe, expect, it, vi } from "vitest";
import { Problem } from "../../src/api/problem";
import type { Job, KeptFrames } from "../../src/api/types";
import { learningControl } from "../../src/views/learning";
import { find } from "./inside";
import { eventually } from "../waiting";

const KEPT: KeptFrames = { on: false, frames: [{ picture: "data:image/png;base64,", sides: ["head from 60 degrees to their left"] }] };
const NONE: KeptFrames = { on: false, frames: [] };

function memory(): Storage {
  const held = new Map<string, string>();
  return {
    getItem: (key: string) => held.get(key) ?? null,
    setItem: (key: string, value: string) => void held.set(key, value),
    removeItem: (key: string) => void held.delete(key),
  } as unknown as Storage;
}

function setUp(kept = KEPT, job: Partial<Job> = { state: "succeeded", error: null }, held = memory()) {
  const person = { id: "p", mine: true, consent: { purposes: ["meetings"], until: null, state: "given" } };
  const api = {
    people: vi.fn(() => Promise.resolve([person])),
    models: vi.fn(() => Promise.resolve([{ id: "m", person_id: "p", preset: "splats" }])),
    giveConsent: vi.fn(() => Promise.resolve(person.consent)),
    watchJob: vi.fn(() => Promise.resolve({ id: "j", ...job })),
  };
  const live = {
    api,
    meeting: { performers: [{ id: "one", name: "Ada", model_id: "m" }] },
    kept: {
      keep: vi.fn((on: boolean) => Promise.resolve(on ? { ...NONE, on: true } : kept)),
      learn: vi.fn(() => Promise.resolve({ id: "j" })),
      drop: vi.fn(() => Promise.resolve()),
    },
  };
  const control = learningControl(live as never, "one", held);
  document.body.append(control.element);
  const box = find<HTMLInputElement>(control.element, "learning");
  const press = async (): Promise<void> => {
    box.checked = !box.checked;
    box.dispatchEvent(new Event("change"));
    await eventually(() => undefined);
    await new Promise((resolve) => setTimeout(resolve, 5));
  };
  return { ...control, live, api, box, press, held, sheet: find<HTMLElement>(control.element, "kept-sheet") };
}

const click = async (element: HTMLElement, testId: string): Promise<void> => {
  find<HTMLButtonElement>(element, testId).click();
  await new Promise((resolve) => setTimeout(resolve, 5));
};

beforeEach(() => (document.body.innerHTML = '<div id="announcer"></div>'));

describe("learning from live look", () => {
  it("is off at first, and asks the server nothing", () => {
    const { box, element, live, sheet } = setUp();
    expect([box.checked, element.classList.contains("on"), sheet.hidden]).toEqual([false, false, true]);
    expect(live.kept.keep).not.toHaveBeenCalled();
  });

  it("gives the consent for learning beside the others, and lights its lamp", async () => {
    const { press, element, api, live } = setUp();
    await press();
    expect(api.giveConsent).toHaveBeenCalledWith("p", { purposes: ["meetings", "learning"], until: null });
    expect(live.kept.keep).toHaveBeenCalledWith(true);
    expect(element.classList.contains("on")).toBe(true);
    expect(element.textContent).toContain("stored only if you say so");
  });

  it("shows at the end what waits, and stores it when told to", async () => {
    const { press, element, live, sheet, held } = setUp();
    await press();
    await press();
    expect([sheet.hidden, sheet.querySelectorAll("img").length]).toEqual([false, 1]);
    expect(element.textContent).toContain("head from 60 degrees to their left");
    expect(live.kept.learn).not.toHaveBeenCalled();
    await click(element, "kept-keep");
    expect(live.kept.learn).toHaveBeenCalledOnce();
    expect(sheet.hidden).toBe(true);
    expect(element.textContent).toContain("has learnt new sides");
    expect(held.getItem("metanerf.learning")).toBeNull();
  });

  it("drops what waits when told to", async () => {
    const { press, element, live, sheet } = setUp();
    await press();
    await press();
    await click(element, "kept-drop");
    expect([live.kept.drop.mock.calls.length, live.kept.learn.mock.calls.length, sheet.hidden]).toEqual([1, 0, true]);
  });

  it("has whoever leaves decide first, and drops what waits for who leaves again", async () => {
    const { press, settle, live, sheet } = setUp();
    await press();
    const left = vi.fn();
    void settle().then(left);
    await new Promise((resolve) => setTimeout(resolve, 5));
    expect([sheet.hidden, left.mock.calls.length]).toEqual([false, 0]);
    await settle();
    await Promise.resolve();
    expect([live.kept.drop.mock.calls.length, live.kept.learn.mock.calls.length, left.mock.calls.length]).toEqual([1, 0, 1]);
  });

  it("lets go at once where nothing was kept", async () => {
    const { press, settle, element, sheet } = setUp(NONE);
    await press();
    await settle();
    expect(sheet.hidden).toBe(true);
    expect(element.textContent).toContain("Nothing was kept");
  });

  it("goes dark with the connection", async () => {
    const { press, lost, box, element } = setUp();
    await press();
    lost();
    expect([box.checked, element.classList.contains("on")]).toEqual([false, false]);
    expect(element.textContent).toContain("was dropped");
  });

  it("says why a model stays as it was, also the next time", async () => {
    const error = { type: "urn:metanerf:forgot-too-much", title: "Forgot too much", status: 422, detail: "The face came out worse." };
    const held = memory();
    held.setItem("metanerf.learning", "j");
    const { element } = setUp(KEPT, { state: "failed", error }, held);
    await new Promise((resolve) => setTimeout(resolve, 5));
    expect(element.textContent).toContain("stays as it was. The face came out worse.");
  });

  it("stays off and says why where it may not", async () => {
    const { press, live, box, element } = setUp();
    live.kept.keep.mockRejectedValueOnce(new Problem("Clip gone", "The clip must be stored.", 410));
    await press();
    expect(box.checked).toBe(false);
    expect(element.textContent).toContain("The clip must be stored.");
  });
});
