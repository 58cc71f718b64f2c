/** Who is shown in a meeting, as this page knows it: asked for now and then, and told by the server at each change. */

import type { Api } from "../api/api";
import type { Meeting, Performer, Viewpoint } from "../api/types";

export interface RosterHooks {
  /** Of the seat; empty while there is nothing to ask for. */
  token(): string;
  onPerformers(performers: readonly Performer[], viewpoint: Viewpoint): void;
  /** Told before `onPerformers`: these are shown no longer. */
  onGone(gone: readonly Performer[]): void;
  onEnvironment(name: string): void;
}

export class PerformerRoster {
  /** What the server said last, to act on each word of it once. */
  private told: string | null = null;

  constructor(
    private readonly api: Pick<Api, "meeting">,
    private readonly meeting: Meeting,
    private readonly hooks: RosterHooks,
  ) {}

  set({ performers, viewpoint }: Pick<Meeting, "performers" | "viewpoint">): void {
    const gone = this.meeting.performers.filter(({ id }) => !performers.some((one) => one.id === id));
    Object.assign(this.meeting, { performers, viewpoint });
    if (gone.length > 0) this.hooks.onGone(gone);
    this.hooks.onPerformers(performers, viewpoint);
  }

  /** Ask who is shown, and where the meeting is held. */
  async refresh(): Promise<void> {
    const token = this.hooks.token();
    if (token === "") return;
    // a roster that can't be had now is asked for again in a moment
    const meeting = await this.api.meeting(this.meeting.id, token).catch(() => null);
    if (!meeting) return;
    this.meeting.join_url = meeting.join_url;
    this.hooks.onEnvironment(meeting.environment);
    this.set(meeting);
  }

  /** Whoever is not among these is shown no longer, at once; whoever is new is asked for. */
  showOnly(performerIds: readonly string[]): void {
    const told = performerIds.join();
    if (told === this.told) return;
    this.told = told;
    const { performers, viewpoint } = this.meeting;
    const kept = performers.filter(({ id }) => performerIds.includes(id));
    if (kept.length < performers.length) this.set({ performers: kept, viewpoint });
    if (performerIds.join() !== kept.map(({ id }) => id).join() || kept.length < performers.length) void this.refresh();
  }
}
