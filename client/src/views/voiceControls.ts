/** The microphone's button, and the others' voices. */

import type { Vec3 } from "../viewpoint/geometry";
import type { MeetingSession } from "../meeting/session";
import { SpatialAudio, type ListenerPose } from "../meeting/spatialAudio";
import { localParticipant } from "../meeting/state";
import { VoiceConnection } from "../meeting/voice";
import { asProblem } from "../api/problem";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { button } from "./shell";

/** The room that voices come from. */
export interface AudioScene {
  /** The listener's head. */
  readonly listener: ListenerPose;
  /** The head of a performer, m; null for one who is not there. */
  headPosition(performerId: string): Vec3 | null;
  /** How late the voices are heard of performers who are heard now, ms. */
  setVoiceDelays(delaysMs: ReadonlyMap<string, number>): void;
}

export interface VoiceControls {
  element: HTMLButtonElement;
  /** Plays the others; without a picture of its own. */
  player: HTMLAudioElement;
  update(): void;
  /** Have voices come from where their speakers stand in `room`. */
  spatialiseIn(room: AudioScene): void;
  close(): void;
}

const POSITION_MS = 50;
const DELAYS_MS = 1000;
/** Space, held down, opens the microphone for so long. */
const TALK_KEY = "Space";

/** `onScreen` hears of the connection that others' screens come by. */
export function voiceControls(
  session: MeetingSession,
  complain: (words: string) => void,
  onScreen: (stream: MediaStream | null) => void,
): VoiceControls {
  const player = h("audio", { autoplay: true, testId: "remote-audio" });
  const element = button("Microphone", () => void toggle(), { look: "glass", icon: "mic", testId: "microphone" });
  element.title = "Microphone on or off; hold Space to talk for a moment";
  const closing = new AbortController();
  const { signal } = closing;
  let wanted = false;
  /** What the server last said. */
  let serverOn = false;
  let wasOpen = false;
  let home = session.home;
  let connection: VoiceConnection | null = null;
  const spatialAudio = new SpatialAudio();
  let timers: ReturnType<typeof setInterval>[] = [];
  player.srcObject = spatialAudio.output;

  const play = (): void => {
    // sound may need a touch first, as after a reload
    Promise.all([player.play(), spatialAudio.resume()]).catch(() =>
      addEventListener("pointerdown", play, { once: true, signal }),
    );
    addEventListener("pointerdown", () => void spatialAudio.resume(), { once: true, signal });
  };
  const connect = async (): Promise<void> => {
    // a preview that ends just now may still give the seat back
    const { ice_servers } = await session.heldSeat();
    if (signal.aborted) return;
    connection = new VoiceConnection(ice_servers, {
      address: (lost) => session.addressOf(`/v1/meetings/${session.meeting.id}/voice`, lost),
      token: async () => (await session.getSeat()).token,
      onChange: () => {
        spatialAudio.setVoices(connection?.slots ?? new Map());
        onScreen(connection?.screen ?? null);
      },
    });
    connection.assignSlots(session.state.slots);
    play();
    void connection.run();
    if (!session.joinsUnmuted && !wanted) return;
    session.joinsUnmuted = false;
    await set(true);
  };
  const set = async (on: boolean): Promise<void> => {
    wanted = on;
    // pressed before there is a connection: it asks for the microphone as soon as it is made
    if (on && !connection) return;
    try {
      if (on) await connection?.acquireMicrophone();
    } catch (error) {
      const { title, detail } = asProblem(error);
      wanted = false;
      return complain(`${title}. ${detail}`);
    }
    // whoever let go of the key meanwhile wants silence
    if (wanted !== on) return;
    connection?.setMicrophoneEnabled(on && serverOn);
    session.send({ type: "microphone", on });
  };
  const toggle = (): Promise<void> => set(!serverOn);
  const performerOf = (memberId: string): string | null | undefined =>
    session.state.members.find(({ id }) => id === memberId)?.performer_id;

  const isTalkKey = ({ target, code }: KeyboardEvent): boolean =>
    code === TALK_KEY && !(target as Element).closest("input, textarea, button, a");
  addEventListener("keydown", (event) => {
    if (!isTalkKey(event)) return;
    event.preventDefault();
    if (!event.repeat && !serverOn) void set(true);
  }, { signal });
  addEventListener("keyup", (event) => {
    if (isTalkKey(event) && wanted) void set(false);
  }, { signal });

  void connect();
  return {
    element,
    player,
    spatialiseIn: (room) => {
      const place = (): void =>
        spatialAudio.setPositions(room.listener, (memberId) => {
          const performerId = performerOf(memberId);
          return performerId ? room.headPosition(performerId) : null;
        });
      const tellDelays = async (): Promise<void> => {
        const delaysMs = (await connection?.bufferDelaysMs()) ?? new Map<string, number>();
        const heard = [...delaysMs].map(([memberId, ms]) => [performerOf(memberId) ?? "", ms + spatialAudio.outputLatencyMs] as const);
        room.setVoiceDelays(new Map(heard));
      };
      timers.forEach(clearInterval);
      timers = [setInterval(place, POSITION_MS), setInterval(() => void tellDelays(), DELAYS_MS)];
    },
    update: () => {
      connection?.assignSlots(session.state.slots);
      if (home !== session.home) connection?.reconnect();
      home = session.home;
      const me = localParticipant(session.state);
      const isOpen = session.connectionState.kind === "open";
      // who comes back after a cut says anew that they want to be heard
      if (isOpen && !wasOpen && wanted) session.send({ type: "microphone", on: true });
      const isNews = isOpen && wasOpen;
      if (!isOpen) serverOn = false;
      wasOpen = isOpen;
      if (!isNews) return;
      const on = me?.microphone ?? false;
      if (serverOn && !on && wanted) {
        wanted = false;
        announce("The host muted you");
      }
      serverOn = on;
      // what the server does not hear is not sent either
      connection?.setMicrophoneEnabled(on && wanted);
      element.setAttribute("aria-pressed", String(on));
      element.querySelector("svg")?.replaceWith(icon(on ? "mic" : "micOff"));
      element.disabled = me?.role === "viewer";
    },
    close: () => {
      closing.abort();
      timers.forEach(clearInterval);
      connection?.close(session.left);
      spatialAudio.close();
      player.srcObject = null;
    },
  };
}
