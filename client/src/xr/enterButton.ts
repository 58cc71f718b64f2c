/** The button that leads into a headset, where the browser offers one. */

import type { LiveView } from "../drawing/live";
import type { MeetingSession } from "../meeting/session";
import { announce } from "../views/dom";
import { button } from "../views/shell";
import type { HeadsetControl } from "../views/meetingView";
import type { Headset, HeadsetActions } from "./headset";

const WORDS = { out: "Enter VR", in: "Leave VR" } as const;
const OPTIONS = { requiredFeatures: ["local-floor"], optionalFeatures: ["hand-tracking"] };

export function enterVrButton(live: LiveView, meetingSession: MeetingSession, ways: HeadsetActions): HeadsetControl {
  const element = button(WORDS.out, () => void toggle(), { look: "glass", icon: "headset", testId: "enter-vr" });
  const system = navigator.xr;
  const closing = new AbortController();
  const { signal } = closing;
  let headset: Headset | null = null;
  element.hidden = true;
  element.title = WORDS.out;

  const offer = async (): Promise<void> => {
    element.hidden = !(await system?.isSessionSupported("immersive-vr").catch(() => false));
  };
  const show = (inside: boolean): void => {
    const words = inside ? WORDS.in : WORDS.out;
    element.querySelector("span")?.replaceChildren(words);
    element.title = words;
    element.setAttribute("aria-pressed", String(inside));
    announce(inside ? "VR session started" : "VR session ended");
  };
  const toggle = async (): Promise<void> => {
    if (headset) return headset.end();
    element.disabled = true;
    try {
      // the browser grants this only while it handles the press: before anything is fetched
      const session = await system?.requestSession("immersive-vr", OPTIONS);
      if (session) headset = await enter(session);
    } catch {
      element.title = "The headset could not be used. Put it on, and try again.";
      announce(element.title);
    }
    element.disabled = false;
  };
  const enter = async (session: XRSession): Promise<Headset | null> => {
    let over = false;
    session.addEventListener("end", () => (over = true));
    // whoever leaves the meeting on the way in is not left in the headset
    const leave = (): void => void session.end().catch(() => undefined);
    signal.addEventListener("abort", leave);
    if (signal.aborted) leave();
    try {
      const { Headset: Entered } = await import("./headset");
      if (over) return null;
      const made = await Entered.enter(session, live, meetingSession, ways);
      made.onEnd = () => {
        headset = null;
        show(false);
      };
      made.onStats = ({ fps, splats }) => {
        element.dataset["fps"] = String(fps);
        element.dataset["splats"] = String(splats);
      };
      show(true);
      return made;
    } catch (error) {
      await session.end().catch(() => undefined);
      throw error;
    }
  };

  void offer();
  system?.addEventListener("devicechange", () => void offer(), { signal });
  return {
    element,
    close: () => {
      closing.abort();
      headset?.end();
    },
  };
}
