/** Live look: a switch, a lamp while it is on, and what leaves the device, in words and as it is. */

import type { LiveView } from "../drawing/live";
import type { MotionCapture } from "../motion/motionCapture";
import { LookSwitch } from "../look/lookSwitch";
import { LookTrack } from "../look/lookTrack";
import { announce, h } from "./dom";
import { foldedWords } from "./foldedWords";

const OFF = "Let the others see you as you look now. A cut-out picture of you then leaves this device; your room does not.";
const ON = "This picture of you leaves this device and goes to the server. It is not stored.";
const PAUSED = "Paused: your network is too slow for pictures. It resumes by itself.";

export interface LiveLookControl {
  element: HTMLElement;
  /** The network has no room for pictures, or has it again. */
  setPoorNetwork(poor: boolean): void;
  close(): void;
}

/** Off at first, always. `onChange` hears whether pictures leave from now on. */
export function liveLookControl(
  live: Pick<LiveView, "setLookTrack">,
  capture: Pick<MotionCapture, "setLook">,
  onChange: (on: boolean) => void,
): LiveLookControl {
  const box = h("input", { type: "checkbox", id: "live-look", testId: "live-look", attributes: { role: "switch", "aria-describedby": "live-look-words" } });
  const preview = h("div", { className: "look-preview", hidden: true, testId: "live-look-preview", attributes: { role: "img", "aria-label": "The picture of you that leaves this device" } });
  const words = foldedWords("live-look-words", "What others get", OFF);
  const element = h(
    "div",
    { className: "live-look" },
    h("div", { className: "switch-row" }, h("label", { attributes: { for: box.id } }, "Live look"), box),
    preview,
    words.element,
  );
  let sent: LookTrack | null = null;

  const show = (on: boolean): void => {
    if (on === (sent !== null)) return;
    sent?.close();
    sent = on ? new LookTrack() : null;
    live.setLookTrack(sent?.track ?? null);
    const now = sent;
    capture.setLook(now && ((picture) => now.show(picture)));
    preview.replaceChildren(...(now ? [now.canvas] : []));
    preview.hidden = !on;
    element.classList.toggle("on", on);
    onChange(on);
  };
  const look = new LookSwitch((on) => {
    show(on);
    if (on || look.paused) words.say(on ? ON : PAUSED);
    else words.explain();
    announce(on ? "Live look is on" : look.paused ? PAUSED : "Live look is off");
  });
  box.addEventListener("change", () => look.setWanted(box.checked));
  return {
    element,
    setPoorNetwork: (poor) => look.setPoorNetwork(poor),
    close: () => show(false),
  };
}
