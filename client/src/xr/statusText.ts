/** Status text in a headset: active speakers, recent messages and reactions, what is being loaded. */

import { lostText } from "../meeting/controlConnection";
import type { MeetingSession } from "../meeting/session";
import { activeSpeakers } from "../meeting/state";
import type { LocalRoom } from "../splats/localRoom";

const SHOWN_MS = 6000;
const MOST_LINES = 3;

export class StatusText {
  private temporary: { words: string; speaker: string | null; untilMs: number | null }[] = [];
  private readonly release: () => void;
  private read: number;
  private captioned: number;

  constructor(private readonly meetingSession: MeetingSession) {
    this.read = meetingSession.state.lastMessageNumber;
    this.captioned = meetingSession.state.caption?.number ?? 0;
    const reaction = meetingSession.onReaction;
    meetingSession.onReaction = (reacted) => {
      reaction(reacted);
      this.show(`${reacted.name}: ${REACTED[reacted.reaction]}`);
    };
    const unwatch = meetingSession.subscribe(() => this.onMeetingChange());
    this.release = () => {
      meetingSession.onReaction = reaction;
      unwatch();
    };
  }

  /** Show `words` for a while; what somebody speaks goes on in place of what they spoke before. */
  show(words: string, speaker: string | null = null): void {
    this.temporary = this.temporary.filter((one) => speaker === null || one.speaker !== speaker);
    this.temporary.push({ words, speaker, untilMs: null });
  }

  /** What is shown at `nowMs`, at most three lines, the newest last. */
  lines(nowMs: number, room: Pick<LocalRoom, "obstacle" | "drawable">): string[] {
    for (const one of this.temporary) one.untilMs ??= nowMs + SHOWN_MS;
    while (this.temporary[0] && (this.temporary[0].untilMs ?? nowMs) < nowMs) this.temporary.shift();
    const { connectionState, state } = this.meetingSession;
    const talking = activeSpeakers(state);
    const lasting = [
      connectionState.kind === "lost" && lostText(connectionState),
      room.obstacle ?? (!room.drawable && "Preparing the picture"),
      talking.length > 0 && `${talking.join(", ")} ${talking.length > 1 ? "speak" : "speaks"}`,
    ].filter((words): words is string => typeof words === "string");
    return [...lasting, ...this.temporary.map(({ words }) => words)].slice(-MOST_LINES);
  }

  close(): void {
    this.release();
  }

  private onMeetingChange(): void {
    const { messages, me, caption } = this.meetingSession.state;
    if (caption && caption.number > this.captioned) {
      this.captioned = caption.number;
      if (caption.participant_id !== me) this.show(`${caption.name}: ${caption.text}`, caption.participant_id);
    }
    for (const { number, name, text, participant_id } of messages) {
      if (number <= this.read) continue;
      this.read = number;
      if (participant_id !== me) this.show(`${name}: ${text}`);
    }
  }
}

const REACTED = {
  agree: "Agree",
  applause: "Applause",
  heart: "Heart",
  laugh: "Laugh",
  surprise: "Surprise",
  party: "Celebrate",
} as const;
