/** Recording a meeting: the host asks, everybody answers, and all see that it runs. */

import type { MeetingSession } from "../meeting/session";
import { isHost } from "../meeting/state";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { button } from "./shell";

export interface RecordingControls {
  /** The host's button. */
  element: HTMLButtonElement;
  /** What is asked, or that it runs. */
  note: HTMLElement;
  update(): void;
}

export function recordingControls(session: MeetingSession): RecordingControls {
  const asked = (): typeof session.state.recording => session.state.recording;
  const element = button("Record", () => session.send({ type: "record", on: asked() === null }), {
    look: "glass",
    icon: "record",
    testId: "record",
  });
  element.title = "Ask everybody whether the meeting may be recorded, or end the recording";
  const words = h("p", { testId: "recording" });
  const agree = button("Agree", () => answer(true), { look: "primary", testId: "recording-agree" });
  const refuse = button("Don’t record me", () => answer(false), { look: "glass", testId: "recording-refuse" });
  const note = h("div", { className: "notification knock glass", hidden: true, attributes: { role: "status" } }, words, agree, refuse);
  let told = "";
  /** Of the newest that we had a part in. */
  let watched: string | null = null;

  const answer = (on: boolean): void => void session.send({ type: "agree", on });
  const say = (text: string, link: string | null = null): void => {
    if (text === told) return;
    told = text;
    announce(text);
    words.replaceChildren(icon("record"), ` ${text} `);
    if (link) words.append(h("a", { href: `/?recording=${link}`, target: "_blank" }, "Watch it"));
  };
  return {
    element,
    note,
    update: () => {
      const recording = asked();
      const mine = recording?.agreed.includes(session.state.me ?? "") ?? false;
      // whose motion the server can't read, it can't record
      element.hidden = !isHost(session.state) || session.meeting.sealed;
      element.setAttribute("aria-pressed", String(recording !== null));
      note.hidden = recording === null && watched === null;
      agree.hidden = recording === null || mine;
      refuse.hidden = recording === null;
      refuse.querySelector("span")?.replaceChildren(mine ? "Stop recording" : "Don’t record me");
      if (recording) {
        if (mine) watched = recording.id;
        if (!mine) say("The host asks to record everybody’s motion, voice and messages");
        else say(recording.running ? "Recording" : "Recording starts once everybody agrees");
      } else if (watched) say("The recording has ended.", watched);
    },
  };
}
