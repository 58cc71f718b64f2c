/** A shared screen: the button for one's own, and the panel that shows whoever's is shared. */

import type { Attendance } from "../meeting/attendance";
import { ScreenShare } from "../meeting/screen";
import { isHost, myself, nameOf } from "../meeting/state";
import { asProblem } from "../api/problem";
import { announce, h } from "./dom";
import { button } from "./shell";

export interface ScreenView {
  /** For the dock. */
  toggle: HTMLButtonElement;
  /** On the stage, while somebody shares. */
  panel: HTMLElement;
  /** Hears of what shows a screen now, if one is shared. */
  onShown: (video: HTMLVideoElement | null) => void;
  /** For the host, while somebody asks to take over. */
  knock: HTMLElement;
  update(): void;
  /** What the voice connection brings of the others' screen. */
  show(stream: MediaStream | null): void;
  close(): void;
}

export function screenView(attendance: Attendance, complain: (words: string) => void): ScreenView {
  const toggle = button("Share screen", () => void press(), { look: "glass", icon: "present", testId: "share-screen" });
  toggle.title = "Share a screen or a window with everybody";
  toggle.hidden = !ScreenShare.offered();
  const frame = screenFrame(() => stop());
  const knock = knockOf(attendance);
  let sharing: ScreenShare | null = null;
  let sent = false;
  let asked = false;
  let others: MediaStream | null = null;

  const address = `/whip/${attendance.meeting.id}`;
  const token = async (): Promise<string> => (await attendance.getSeat()).token;

  const letGo = (): void => {
    sharing?.close();
    sharing = null;
    sent = asked = false;
  };
  const end = (): void => {
    attendance.wish({ type: "present", on: false });
    letGo();
    update();
  };
  /** By the presenter, or by the host. */
  const stop = (): void => {
    const { presenter } = attendance.state;
    if (sharing) end();
    else if (presenter) attendance.wish({ type: "let-present", participant_id: presenter, on: false });
  };
  const press = async (): Promise<void> => {
    if (sharing) return end();
    try {
      sharing = await ScreenShare.choose(address, token);
      if (!sharing) return;
      sharing.watch(end);
      attendance.wish({ type: "present", on: true });
      update();
    } catch (error) {
      tell(error);
    }
  };
  const tell = (error: unknown): void => {
    const { title, detail } = asProblem(error);
    complain(`${title}. ${detail}`);
  };
  const send = async (): Promise<void> => {
    sent = true;
    const current = sharing;
    try {
      await current?.send();
    } catch (error) {
      // let go of meanwhile, perhaps for another
      if (sharing !== current) return;
      end();
      tell(error);
    }
  };
  /** What the host decided of our asking, or of our sharing. */
  const follow = (): void => {
    const { me, presenter, asksToPresent } = attendance.state;
    if (!sharing) return;
    if (presenter === me) return void (sent || send());
    if (asksToPresent === me) {
      if (!asked) complain("The host is asked whether you may share your screen now.");
      asked = true;
    } else if (sent || asked) {
      complain(sent ? "Your screen is no longer shared." : "The host did not let you share your screen.");
      letGo();
    }
  };
  const update = (): void => {
    follow();
    const { me, presenter } = attendance.state;
    const mine = presenter !== null && presenter === me;
    toggle.setAttribute("aria-pressed", String(sharing !== null));
    toggle.disabled = myself(attendance.state)?.role === "viewer";
    const stream = mine ? (sharing?.stream ?? null) : presenter ? others : null;
    const whose = mine ? "Your screen" : `${nameOf(attendance.state, presenter ?? "")}’s screen`;
    frame.show(stream, whose, mine || isHost(attendance.state));
    made.onShown(stream && frame.video);
    knock.update();
  };
  const made: ScreenView = {
    toggle,
    onShown: () => undefined,
    panel: frame.element,
    knock: knock.element,
    update,
    show: (stream) => {
      others = stream;
      update();
    },
    close: letGo,
  };
  return made;
}

function screenFrame(onStop: () => void): {
  element: HTMLElement;
  video: HTMLVideoElement;
  show(stream: MediaStream | null, whose: string, mayStop: boolean): void;
} {
  const video = h("video", { autoplay: true, muted: true, playsInline: true, testId: "screen-video" });
  const title = h("span", {});
  const size = button("Larger", () => enlarge(!element.classList.contains("large")), { look: "glass", icon: "enlarge", testId: "screen-size" });
  const end = button("Stop", onStop, { look: "glass", icon: "close", testId: "screen-stop" });
  const bar = h("figcaption", {}, title, size, end);
  const element = h("figure", { className: "screen", hidden: true, testId: "screen" }, video, bar);
  const enlarge = (large: boolean): void => {
    element.classList.toggle("large", large);
    size.setAttribute("aria-pressed", String(large));
  };
  enlarge(false);
  return {
    element,
    video,
    show: (stream, whose, mayStop) => {
      if (element.hidden !== (stream === null)) announce(stream === null ? "The screen is no longer shared" : `${whose} is shared`);
      element.hidden = stream === null;
      title.textContent = whose;
      video.setAttribute("aria-label", whose);
      end.hidden = !mayStop;
      if (video.srcObject !== stream) video.srcObject = stream;
      // refused only where even muted video may not start by itself
      if (stream) video.play().catch(() => undefined);
    },
  };
}

function knockOf(attendance: Attendance): { element: HTMLElement; update(): void } {
  const words = h("p", {});
  const decide = (on: boolean): void => {
    const who = attendance.state.asksToPresent;
    if (who) attendance.wish({ type: "let-present", participant_id: who, on });
  };
  const allow = button("Let share", () => decide(true), { look: "primary", testId: "present-allow" });
  const deny = button("Not now", () => decide(false), { look: "glass", testId: "present-deny" });
  const element = h("div", { className: "note knock glass", hidden: true, testId: "present-knock" }, words, allow, deny);
  return {
    element,
    update: () => {
      const { asksToPresent, me } = attendance.state;
      element.hidden = asksToPresent === null || asksToPresent === me;
      if (element.hidden) return;
      words.replaceChildren(h("strong", {}, nameOf(attendance.state, asksToPresent ?? "")), " asks to share a screen");
    },
  };
}
