/** A shared screen: the button for one's own, and the panel that shows whoever's is shared. */

import type { MeetingSession } from "../meeting/session";
import { ScreenShare } from "../meeting/screen";
import { isHost, localParticipant, nameOf } from "../meeting/state";
import { asProblem } from "../api/problem";
import { announce, h } from "./dom";
import { button } from "./shell";

export interface ScreenView {
  /** For the dock. */
  toggle: HTMLButtonElement;
  /** On the viewport, while somebody shares. */
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

export function screenView(session: MeetingSession, complain: (words: string) => void): ScreenView {
  const toggle = button("Share screen", () => void press(), { look: "glass", icon: "present", testId: "share-screen" });
  toggle.title = "Share a screen or a window with everybody";
  toggle.hidden = !ScreenShare.isSupported();
  const frame = screenFrame(() => stop());
  const knock = shareRequest(session);
  let sharing: ScreenShare | null = null;
  let sent = false;
  let asked = false;
  let others: MediaStream | null = null;

  const address = (): Promise<string> => session.addressOf(`/whip/${session.meeting.id}`, false);
  const token = async (): Promise<string> => (await session.getSeat()).token;

  const stopSharing = (): void => {
    sharing?.close();
    sharing = null;
    sent = asked = false;
  };
  const end = (): void => {
    session.send({ type: "present", on: false });
    stopSharing();
    update();
  };
  /** By the presenter, or by the host. */
  const stop = (): void => {
    const { presenter } = session.state;
    if (sharing) end();
    else if (presenter) session.send({ type: "let-present", participant_id: presenter, on: false });
  };
  const press = async (): Promise<void> => {
    if (sharing) return end();
    try {
      sharing = await ScreenShare.choose(address, token);
      if (!sharing) return;
      sharing.watch(end);
      session.send({ type: "present", on: true });
      update();
    } catch (error) {
      reportError(error);
    }
  };
  const reportError = (error: unknown): void => {
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
      reportError(error);
    }
  };
  /** What the host decided of our asking, or of our sharing. */
  const follow = (): void => {
    const { me, presenter, presentRequestFrom } = session.state;
    if (!sharing) return;
    if (presenter === me) return void (sent || send());
    if (presentRequestFrom === me) {
      if (!asked) complain("The host has been asked whether you may share your screen.");
      asked = true;
    } else if (sent || asked) {
      complain(sent ? "Your screen is no longer shared." : "The host did not let you share your screen.");
      stopSharing();
    }
  };
  const update = (): void => {
    follow();
    const { me, presenter } = session.state;
    const mine = presenter !== null && presenter === me;
    toggle.setAttribute("aria-pressed", String(sharing !== null));
    toggle.disabled = localParticipant(session.state)?.role === "viewer";
    const stream = mine ? (sharing?.stream ?? null) : presenter ? others : null;
    const whose = mine ? "Your screen" : `${nameOf(session.state, presenter ?? "")}’s screen`;
    frame.show(stream, whose, mine || isHost(session.state));
    view.onShown(stream && frame.video);
    knock.update();
  };
  const view: ScreenView = {
    toggle,
    onShown: () => undefined,
    panel: frame.element,
    knock: knock.element,
    update,
    show: (stream) => {
      others = stream;
      update();
    },
    close: stopSharing,
  };
  return view;
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

function shareRequest(session: MeetingSession): { element: HTMLElement; update(): void } {
  const words = h("p", {});
  const decide = (on: boolean): void => {
    const who = session.state.presentRequestFrom;
    if (who) session.send({ type: "let-present", participant_id: who, on });
  };
  const allow = button("Allow", () => decide(true), { look: "primary", testId: "present-allow" });
  const deny = button("Not now", () => decide(false), { look: "glass", testId: "present-deny" });
  const element = h("div", { className: "notification knock glass", hidden: true, testId: "present-knock" }, words, allow, deny);
  return {
    element,
    update: () => {
      const { presentRequestFrom, me } = session.state;
      element.hidden = presentRequestFrom === null || presentRequestFrom === me;
      if (element.hidden) return;
      words.replaceChildren(h("strong", {}, nameOf(session.state, presentRequestFrom ?? "")), " asks to share a screen");
    },
  };
}
