/** The local participant's session in a meeting: seat, name, control connection and state. */

import type { Api } from "../api/api";
import type { Connection, FromServer, Meeting, Reacted, Refusal, Seat, ToServer } from "../api/types";
import { NetworkQualityMeter } from "./networkQuality";
import { ControlConnection, type ControlState } from "./controlConnection";
import { INITIAL_STATE, applyMessage, localParticipant, announcementsOf, type MeetingState } from "./state";

/** What a reload needs to take the same seat up again. */
export interface StoredSeat {
  meetingId: string;
  name: string;
  seat: Seat;
  /** Number of the newest message that was read. */
  lastRead: number;
}

export interface SeatStore {
  get(): StoredSeat | null;
  set(ticket: StoredSeat | null): void;
}

type Listener = () => void;

export class MeetingSession {
  state: MeetingState = INITIAL_STATE;
  /** The microphone is to go on as soon as we are in. */
  joinsUnmuted = false;
  connectionState: ControlState = { kind: "connecting" };
  /** The server was told that we leave, and ends by itself what came with the seat. */
  left = false;
  /** How well the network carries the meeting, as far as is known. */
  network: Connection = "good";
  /** Number of the newest message that was read, before a reload too. */
  lastRead = 0;
  onAnnouncement: (words: string) => void = () => undefined;
  onReaction: (reacted: Reacted) => void = () => undefined;
  onRefusal: (refusal: Refusal) => void = () => undefined;
  /** Address of the gateway that the meeting lives on; null until it is known. */
  home: string | null = null;
  private seat: Seat | null = null;
  /** Token of the seat that the control connection took up. */
  private heldToken: string | null = null;
  private waiting: Listener[] = [];
  private joining: Promise<Seat> | null = null;
  private name = "Guest";
  private readonly meter = new NetworkQualityMeter();
  private channel: ControlConnection | null = null;
  private readonly listeners = new Set<Listener>();

  constructor(
    private readonly api: Api,
    readonly meeting: Meeting,
    private readonly seatStore: SeatStore,
    private readonly makeConnection: (
      ...hooks: ConstructorParameters<typeof ControlConnection>
    ) => ControlConnection = (...hooks) => new ControlConnection(...hooks),
  ) {}

  /** The seat, for the live picture too; a new one where there is none or it was given back. */
  async getSeat(stale = false): Promise<Seat> {
    if (stale) this.seat = null;
    if (this.seat) return this.seat;
    // picture, voice and control connection that ask at once sit on one seat
    this.joining ??= this.api.join(this.meeting.id, this.name).finally(() => {
      this.joining = null;
    });
    this.seat = await this.joining;
    this.setHome(this.seat.gateway_url);
    this.storeSeat();
    return this.seat;
  }

  /**
   * The seat once the control connection has taken it up: from then on it stays ours, however the picture goes, whose
   * end gives back a seat that is only looked from. Waits for ever where we are not let in, which the page then says.
   */
  async heldSeat(): Promise<Seat> {
    while (this.seat === null || this.seat.token !== this.heldToken) await new Promise<void>((resolve) => this.waiting.push(resolve));
    return this.seat;
  }

  /**
   * Where `path` is answered: at the gateway that the meeting lives on, which is asked for where it is not known, or a
   * connection to it was `lost`. Throws a Problem.
   */
  async addressOf(path: string, lost: boolean): Promise<string> {
    const { token } = await this.getSeat();
    if (lost || this.home === null) this.setHome(await this.api.home(this.meeting.id, token));
    return new URL(path, this.home || location.href).href;
  }

  /** Come in by `name`, or wait to be let in; on the seat of `ticket` if there is one. */
  join(name: string, stored: StoredSeat | null = null): void {
    this.name = name;
    this.seat = stored?.seat ?? this.seat;
    this.lastRead = stored?.lastRead ?? this.lastRead;
    let lost = false;
    let told: string | null = null;
    this.channel = this.makeConnection({
      hello: async (stale) => {
        const { token } = await this.getSeat(stale);
        told = token;
        this.storeSeat();
        const address = socketAddress(await this.addressOf(`/v1/meetings/${this.meeting.id}/control`, lost));
        lost = true;
        return { address, token, name, after: this.state.lastMessageNumber };
      },
      onRoundTrip: (milliseconds) => {
        const connection = this.meter.observe(milliseconds);
        if (!connection) return;
        this.network = connection;
        if (this.admitted) this.send({ type: "network", connection });
        else this.meter.reset();
        this.notify();
      },
      onMessage: (message) => this.handle(message),
      onState: (state) => {
        this.connectionState = state;
        // who spoke when the connection was lost is not who speaks now
        if (state.kind !== "open") this.state = { ...this.state, speaking: [] };
        if (state.kind === "open") this.hold(told);
        // another tab of ours that goes on leaves this one a way back
        if (state.kind === "ended" && state.reason !== "replaced") this.seatStore.set(null);
        this.notify();
      },
    });
    void this.channel.run();
  }

  get joined(): boolean {
    return this.channel !== null;
  }

  /** Whether there is anything to see for us. */
  get admitted(): boolean {
    return localParticipant(this.state)?.admission === "admitted";
  }

  /** Ask the server for something; false where the connection is down. */
  send(message: ToServer): boolean {
    return this.channel?.send(message) ?? false;
  }

  /** As the host, have a new link bring people in, and those of before nobody. Throws a Problem. */
  async renewInvitation(): Promise<void> {
    this.meeting.join_url = await this.api.renewInvitation(this.meeting.id, (await this.getSeat()).token);
  }

  /** Called at each change, until the returned function is. */
  subscribe(listener: Listener): () => void {
    this.listeners.add(listener);
    listener();
    return () => this.listeners.delete(listener);
  }

  /** Whatever came so far has been read. */
  markRead(): void {
    if (this.lastRead === this.state.lastMessageNumber) return;
    this.lastRead = this.state.lastMessageNumber;
    this.storeSeat();
  }

  /** Give the seat back. */
  leave(): void {
    this.left = this.send({ type: "leave" });
    this.seatStore.set(null);
    this.close();
  }

  /** Close the connection; the seat waits a while for us to come back. */
  close(): void {
    this.channel?.close();
    this.listeners.clear();
  }

  private handle(message: FromServer): void {
    if (message.type === "reacted") this.onReaction(message);
    if (message.type === "refusal") this.onRefusal(message);
    const before = this.state;
    this.state = applyMessage(before, message);
    const news = announcementsOf(before, this.state);
    if (news.length > 0) this.onAnnouncement(news.join(". "));
    this.notify();
  }

  private hold(token: string | null): void {
    this.meter.reset();
    this.heldToken = token;
    const waiting = this.waiting.splice(0);
    waiting.forEach((goOn) => goOn());
  }

  private setHome(home: string): void {
    const moved = this.home !== home;
    this.home = home;
    if (moved) this.notify();
  }

  private storeSeat(): void {
    const { seat, name, lastRead } = this;
    if (seat && this.joined) this.seatStore.set({ meetingId: this.meeting.id, name, seat, lastRead });
  }

  private notify(): void {
    for (const listener of [...this.listeners]) listener();
  }
}

/** The address by which a WebSocket is opened. */
export function socketAddress(url: string): string {
  const address = new URL(url);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  return address.href;
}
