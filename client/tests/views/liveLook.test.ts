// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { liveLookControl } from "../../src/views/liveLook";
import { find } from "./inside";

class FakeTrack {
  stopped = false;
  stop(): void {
    this.stopped = true;
  }
}

let tracks: FakeTrack[] = [];
const drawn = vi.fn();

beforeEach(() => {
  tracks = [];
  document.body.innerHTML = '<div id="announcer"></div>';
  const canvas = HTMLCanvasElement.prototype as unknown as Record<string, unknown>;
  canvas["getContext"] = () => ({ drawImage: drawn });
  canvas["captureStream"] = () => ({ getVideoTracks: () => [tracks[tracks.push(new FakeTrack()) - 1]] });
});
afterEach(() => drawn.mockClear());

function setUp() {
  const live = { setLookTrack: vi.fn() };
  const capture = { setLook: vi.fn() };
  const onChange = vi.fn();
  const control = liveLookControl(live, capture, onChange);
  document.body.append(control.element);
  const box = find<HTMLInputElement>(control.element, "live-look");
  const press = (): void => {
    box.checked = !box.checked;
    box.dispatchEvent(new Event("change"));
  };
  const preview = find<HTMLElement>(control.element, "live-look-preview");
  return { ...control, live, capture, onChange, box, press, preview };
}

describe("live look", () => {
  it("is off at first, and says what would leave", () => {
    const { element, live, capture, box, preview } = setUp();
    expect([box.checked, preview.hidden, element.classList.contains("on")]).toEqual([false, true, false]);
    expect(element.textContent).toContain("A cut-out picture of you then leaves this device");
    expect([live.setLookTrack.mock.calls, capture.setLook.mock.calls]).toEqual([[], []]);
  });

  it("shows what leaves, with a lamp, while it is on", () => {
    const { element, live, capture, onChange, press, preview } = setUp();
    press();
    expect([preview.hidden, element.classList.contains("on"), preview.querySelector("canvas") !== null]).toEqual([false, true, true]);
    expect(live.setLookTrack).toHaveBeenLastCalledWith(tracks[0]);
    const picture = { close: vi.fn() };
    const show = capture.setLook.mock.lastCall?.[0] as (one: unknown) => void;
    show(picture);
    expect(drawn).toHaveBeenCalledWith(picture, 0, 0);
    expect(picture.close).toHaveBeenCalled();
    expect(element.textContent).toContain("This picture of you leaves this device");
    press();
    expect([live.setLookTrack.mock.lastCall, capture.setLook.mock.lastCall]).toEqual([[null], [null]]);
    expect([tracks[0]?.stopped, preview.hidden, preview.childElementCount]).toEqual([true, true, 0]);
    expect(onChange.mock.calls).toEqual([[true], [false]]);
  });

  it("gives way to a poor network, says so, and comes back by itself", () => {
    const { element, live, press, setPoorNetwork, box, preview } = setUp();
    press();
    setPoorNetwork(true);
    expect(live.setLookTrack).toHaveBeenLastCalledWith(null);
    expect([box.checked, preview.hidden]).toEqual([true, true]);
    expect(element.textContent).toContain("Paused");
    setPoorNetwork(false);
    expect(live.setLookTrack).toHaveBeenLastCalledWith(tracks[1]);
    expect(preview.hidden).toBe(false);
  });

  it("ends with the camera", () => {
    const { live, press, close } = setUp();
    close();
    expect(live.setLookTrack).not.toHaveBeenCalled();
    press();
    close();
    expect([live.setLookTrack.mock.lastCall, tracks[0]?.stopped]).toEqual([[null], true]);
  });
});
