/** The microphone's button, and the others' voices. */

import type { Attendance } from "../meeting/attendance";
import { myself } from "../meeting/state";
import { VoiceLink } from "../meeting/voice";
import { asProblem } from "../problem";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { button } from "./shell";

export interface VoiceControls {
  element: HTMLButtonElement;
  /** Plays the others; without a picture of its own. */
  player: HTMLAudioElement;
  update(): void;
  close(): void;
}

/** Space, held down, opens the microphone for so long. */
const TALK_KEY = "Space";

export function voiceControls(attendance: Attendance, complain: (words: string) => void): VoiceControls {
  const player = h("audio", { autoplay: true, testId: "others" });
  const element = button("Microphone", () => void toggle(), { look: "glass", icon: "mic", testId: "microphone" });
  element.title = "Microphone on or off; hold Space to talk for a moment";
  const closing = new AbortController();
  const { signal } = closing;
  let wanted = false;
  /** What the server last said. */
  let told = false;
  let wasOpen = false;
  let link: VoiceLink | null = null;

  const play = (): void => {
    // sound may need a touch first, as after a reload
    player.play().catch(() => addEventListener("pointerdown", play, { once: true, signal }));
  };
  const listen = async (): Promise<void> => {
    const { ice_servers } = await attendance.getSeat();
    if (signal.aborted) return;
    link = new VoiceLink(`/v1/meetings/${attendance.meeting.id}/voice`, ice_servers, {
      token: async () => (await attendance.getSeat()).token,
      onOthers: (stream) => {
        player.srcObject = stream;
        play();
      },
    });
    void link.run();
  };
  const set = async (on: boolean): Promise<void> => {
    wanted = on;
    try {
      if (on) await link?.prepare();
    } catch (error) {
      const { title, detail } = asProblem(error);
      wanted = false;
      return complain(`${title}. ${detail}`);
    }
    // whoever let go of the key meanwhile wants silence
    if (wanted !== on) return;
    if (!on) link?.open(false);
    attendance.wish({ type: "microphone", on });
  };
  const toggle = (): Promise<void> => set(!told);

  const free = ({ target, code }: KeyboardEvent): boolean =>
    code === TALK_KEY && !(target as Element).closest("input, textarea, button, a");
  addEventListener("keydown", (event) => {
    if (!free(event)) return;
    event.preventDefault();
    if (!event.repeat && !told) void set(true);
  }, { signal });
  addEventListener("keyup", (event) => {
    if (free(event) && wanted) void set(false);
  }, { signal });

  void listen();
  return {
    element,
    player,
    update: () => {
      const me = myself(attendance.state);
      const isOpen = attendance.line.kind === "open";
      // who comes back after a cut says anew that they want to be heard
      if (isOpen && !wasOpen && wanted) attendance.wish({ type: "microphone", on: true });
      const isNews = isOpen && wasOpen;
      if (!isOpen) told = false;
      wasOpen = isOpen;
      if (!isNews) return;
      const on = me?.microphone ?? false;
      if (told && !on && wanted) {
        wanted = false;
        announce("The host switched your microphone off");
      }
      told = on;
      // what the server does not hear is not sent either
      link?.open(on && wanted);
      element.setAttribute("aria-pressed", String(on));
      element.querySelector("svg")?.replaceWith(icon(on ? "mic" : "micOff"));
      element.disabled = me?.role === "viewer";
    },
    close: () => {
      closing.abort();
      link?.close();
      player.srcObject = null;
    },
  };
}
