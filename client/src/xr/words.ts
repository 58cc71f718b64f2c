/** The line of words in a headset: who speaks, what was written and shown last, what one waits for. */

import type { Attendance } from "../meeting/attendance";
import { speakers } from "../meeting/state";
import type { LocalRoom } from "../splats/localRoom";

const SHOWN_MS = 6000;
const MOST_LINES = 3;

export class Words {
  private passing: { words: string; speaker: string | null; untilMs: number | null }[] = [];
  private readonly release: () => void;
  private read: number;
  private captioned: number;

  constructor(private readonly attendance: Attendance) {
    this.read = attendance.state.number;
    this.captioned = attendance.state.caption?.number ?? 0;
    const reaction = attendance.onReaction;
    attendance.onReaction = (reacted) => {
      reaction(reacted);
      this.tell(`${reacted.name}: ${REACTED[reacted.reaction]}`);
    };
    const unwatch = attendance.watch(() => this.hear());
    this.release = () => {
      attendance.onReaction = reaction;
      unwatch();
    };
  }

  /** Show `words` for a while; what somebody speaks goes on in place of what they spoke before. */
  tell(words: string, speaker: string | null = null): void {
    this.passing = this.passing.filter((one) => speaker === null || one.speaker !== speaker);
    this.passing.push({ words, speaker, untilMs: null });
  }

  /** What is shown at `nowMs`, at most three lines, the newest last. */
  lines(nowMs: number, room: Pick<LocalRoom, "obstacle" | "drawable">): string[] {
    for (const one of this.passing) one.untilMs ??= nowMs + SHOWN_MS;
    while (this.passing[0] && (this.passing[0].untilMs ?? nowMs) < nowMs) this.passing.shift();
    const { line, state } = this.attendance;
    const talking = speakers(state);
    const lasting = [
      line.kind === "lost" && "Connection lost. Coming back",
      room.obstacle ?? (!room.drawable && "Getting the picture ready"),
      talking.length > 0 && `${talking.join(", ")} ${talking.length > 1 ? "speak" : "speaks"}`,
    ].filter((words): words is string => typeof words === "string");
    return [...lasting, ...this.passing.map(({ words }) => words)].slice(-MOST_LINES);
  }

  close(): void {
    this.release();
  }

  private hear(): void {
    const { said, me, caption } = this.attendance.state;
    if (caption && caption.number > this.captioned) {
      this.captioned = caption.number;
      if (caption.participant_id !== me) this.tell(`${caption.name}: ${caption.text}`, caption.participant_id);
    }
    for (const { number, name, text, participant_id } of said) {
      if (number <= this.read) continue;
      this.read = number;
      if (participant_id !== me) this.tell(`${name}: ${text}`);
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
