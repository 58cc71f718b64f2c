/** Our own part in a meeting: the seat, the name on it, the line to the others, what came by it. */

import type { Api } from "../api/api";
import type { FromServer, Meeting, Reacted, Refusal, Seat, ToServer } from "../api/types";
import { ConnectionMeter } from "./connection";
import { ControlConnection, type ControlState } from "./controlConnection";
import { NOBODY_YET, heard, myself, newsOf, type MeetingState } from "./state";

/** What a reload needs to take the same seat up again. */
export interface Ticket {
  meetingId: string;
  name: string;
  seat: Seat;
  /** Number of the newest message that was read. */
  read: number;
}

export interface TicketStore {
  get(): Ticket | null;
  set(ticket: Ticket | null): void;
}

type Listener = () => void;

export class Attendance {
  state: MeetingState = NOBODY_YET;
  /** The microphone is to go on as soon as we are in. */
  comesHeard = false;
  line: ControlState = { kind: "connecting" };
  /** Number of the newest message that was read, before a reload too. */
  read = 0;
  onNews: (words: string) => void = () => undefined;
  onReaction: (reacted: Reacted) => void = () => undefined;
  onRefusal: (refusal: Refusal) => void = () => undefined;
  private seat: Seat | null = null;
  private joining: Promise<Seat> | null = null;
  private name = "Guest";
  private readonly meter = new ConnectionMeter();
  private channel: ControlConnection | null = null;
  private readonly listeners = new Set<Listener>();

  constructor(
    private readonly api: Api,
    readonly meeting: Meeting,
    private readonly tickets: TicketStore,
    private readonly makeConnection: (
      ...hooks: ConstructorParameters<typeof ControlConnection>
    ) => ControlConnection = (...hooks) => new ControlConnection(...hooks),
  ) {}

  /** The seat, for the live picture too; a new one where there is none or it was given back. */
  async getSeat(stale = false): Promise<Seat> {
    if (stale) this.seat = null;
    if (this.seat) return this.seat;
    // picture, voice and line that ask at once sit on one seat
    this.joining ??= this.api.join(this.meeting.id, this.name).finally(() => {
      this.joining = null;
    });
    this.seat = await this.joining;
    this.keep();
    return this.seat;
  }

  /** Come in by `name`, or wait to be let in; on the seat of `ticket` if there is one. */
  enter(name: string, ticket: Ticket | null = null): void {
    this.name = name;
    this.seat = ticket?.seat ?? this.seat;
    this.read = ticket?.read ?? this.read;
    this.channel = this.makeConnection({
      greeting: async (stale) => {
        const { token, control_url } = await this.getSeat(stale);
        this.keep();
        return { address: socketAddress(control_url), token, name, after: this.state.number };
      },
      onRoundTrip: (milliseconds) => {
        const connection = this.meter.observe(milliseconds);
        if (connection && this.admitted) this.wish({ type: "network", connection });
        else if (connection) this.meter.forget();
      },
      onMessage: (message) => this.hear(message),
      onState: (state) => {
        this.line = state;
        // who spoke when the line was cut is not who speaks now
        if (state.kind !== "open") this.state = { ...this.state, speaking: [] };
        if (state.kind === "open") this.meter.forget();
        // another tab of ours that goes on leaves this one a way back
        if (state.kind === "over" && state.reason !== "replaced") this.tickets.set(null);
        this.changed();
      },
    });
    void this.channel.run();
  }

  get entered(): boolean {
    return this.channel !== null;
  }

  /** Whether there is anything to see for us. */
  get admitted(): boolean {
    return myself(this.state)?.admission === "admitted";
  }

  /** Ask the server for something; false where the line is down. */
  wish(message: ToServer): boolean {
    return this.channel?.send(message) ?? false;
  }

  /** Called at each change, until the returned function is. */
  watch(listener: Listener): () => void {
    this.listeners.add(listener);
    listener();
    return () => this.listeners.delete(listener);
  }

  /** Whatever came so far has been read. */
  markRead(): void {
    if (this.read === this.state.number) return;
    this.read = this.state.number;
    this.keep();
  }

  /** Give the seat back. */
  leave(): void {
    this.wish({ type: "leave" });
    this.tickets.set(null);
    this.close();
  }

  /** Let go of the line; the seat waits a while for us to come back. */
  close(): void {
    this.channel?.close();
    this.listeners.clear();
  }

  private hear(message: FromServer): void {
    if (message.type === "reacted") this.onReaction(message);
    if (message.type === "refusal") this.onRefusal(message);
    const before = this.state;
    this.state = heard(before, message);
    const news = newsOf(before, this.state);
    if (news.length > 0) this.onNews(news.join(". "));
    this.changed();
  }

  private keep(): void {
    const { seat, name, read } = this;
    if (seat && this.entered) this.tickets.set({ meetingId: this.meeting.id, name, seat, read });
  }

  private changed(): void {
    for (const listener of [...this.listeners]) listener();
  }
}

/** The WebSocket's address beside the page's own. */
export function socketAddress(path: string, page: string = location.href): string {
  const address = new URL(path, page);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  return address.href;
}
