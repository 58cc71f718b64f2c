/** The microphone's button, and the others' voices. */

import type { Vec3 } from "../viewpoint/geometry";
import type { Attendance } from "../meeting/attendance";
import { Hearing, type Ears } from "../meeting/hearing";
import { myself } from "../meeting/state";
import { VoiceLink } from "../meeting/voice";
import { asProblem } from "../api/problem";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { button } from "./shell";

/** The room that voices come from. */
export interface Surroundings {
  /** The listener's head. */
  readonly ears: Ears;
  /** The head of a performer, m; null for one who is not there. */
  headOf(performerId: string): Vec3 | null;
}

export interface VoiceControls {
  element: HTMLButtonElement;
  /** Plays the others; without a picture of its own. */
  player: HTMLAudioElement;
  update(): void;
  /** Have voices come from where their speakers stand in `room`. */
  hearIn(room: Surroundings): void;
  close(): void;
}

const PLACE_MS = 50;
/** Space, held down, opens the microphone for so long. */
const TALK_KEY = "Space";

/** `onScreen` hears of the connection that others' screens come by. */
export function voiceControls(
  attendance: Attendance,
  complain: (words: string) => void,
  onScreen: (stream: MediaStream | null) => void,
): VoiceControls {
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
  const hearing = new Hearing();
  let placing: ReturnType<typeof setInterval> | undefined;
  player.srcObject = hearing.mix;

  const play = (): void => {
    // sound may need a touch first, as after a reload
    Promise.all([player.play(), hearing.resume()]).catch(() =>
      addEventListener("pointerdown", play, { once: true, signal }),
    );
    addEventListener("pointerdown", () => void hearing.resume(), { once: true, signal });
  };
  const listen = async (): Promise<void> => {
    const { ice_servers } = await attendance.getSeat();
    if (signal.aborted) return;
    link = new VoiceLink(`/v1/meetings/${attendance.meeting.id}/voice`, ice_servers, {
      token: async () => (await attendance.getSeat()).token,
      onChange: () => {
        hearing.show(link?.slots ?? new Map());
        onScreen(link?.screen ?? null);
      },
    });
    link.assign(attendance.state.slots);
    play();
    void link.run();
    if (!attendance.comesHeard) return;
    attendance.comesHeard = false;
    await set(true);
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
    hearIn: (room) => {
      const place = (): void =>
        hearing.place(room.ears, (memberId) => {
          const performerId = attendance.state.members.find(({ id }) => id === memberId)?.performer_id;
          return performerId ? room.headOf(performerId) : null;
        });
      clearInterval(placing);
      placing = setInterval(place, PLACE_MS);
    },
    update: () => {
      link?.assign(attendance.state.slots);
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
      clearInterval(placing);
      link?.close();
      hearing.close();
      player.srcObject = null;
    },
  };
}
