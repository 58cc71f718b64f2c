/**
 * The control channel: a WebSocket that says hello with the seat's token, beats once a second, and
 * comes back by itself after a cut, until it is closed or the server says goodbye for good.
 */

import { Problem, asProblem } from "../api/problem";
import type { FromServer, Goodbye, ToServer } from "../api/types";
import { sleep } from "../api/until";

export type ControlState =
  | { kind: "connecting" }
  | { kind: "open" }
  /** `waitS`: so long the server wants to hear nothing of us. */
  | { kind: "lost"; waitS?: number }
  | { kind: "ended"; reason: Goodbye["reason"]; problem: Problem | null };

export interface HelloDetails {
  address: string;
  token: string;
  name: string;
  /** Number of the newest message that has come. */
  after: number;
}

export interface ControlHooks {
  /** Whose seat to take up; `stale` when the last one was given back. */
  hello(stale: boolean): Promise<HelloDetails>;
  onMessage(message: FromServer): void;
  onState(state: ControlState): void;
  /** A beat has come back. */
  onRoundTrip(milliseconds: number): void;
}

const HEARTBEAT_MS = 1000;
/** The server's own patience, too: no answer for so long and the connection is cut. */
const HEARTBEAT_TIMEOUT_MS = 5000;
const CONNECT_TIMEOUT_MS = 3000;
const MAX_DELAY_MS = 1000;
/** Where the server asks for patience but does not say how long. */
const THROTTLED_S = 5;

/** The pause before attempt `attempt` (from 0): short, so that a meeting is back within seconds. */
export function reconnectDelayMs(attempt: number, random: number): number {
  return Math.min(MAX_DELAY_MS, 150 * 2 ** attempt) * (0.75 + 0.25 * random);
}

/** What to tell people of a lost connection. */
export function lostText({ waitS }: Extract<ControlState, { kind: "lost" }>): string {
  return waitS === undefined
    ? "Connection lost. Reconnecting"
    : `Too many requests. Trying again in ${waitS} s`;
}

export class ControlConnection {
  private readonly closing = new AbortController();
  private socket: WebSocket | null = null;
  private welcomed = false;
  private stale = false;

  constructor(
    private readonly hooks: ControlHooks,
    private readonly open: (address: string) => WebSocket = (address) => new WebSocket(address),
  ) {}

  /** Connect and stay connected; returns when closed or over. */
  async run(): Promise<void> {
    this.hooks.onState({ kind: "connecting" });
    for (let attempt = 0; !this.closing.signal.aborted; attempt++) {
      let waitS: number | null = null;
      try {
        const hello = await this.hooks.hello(this.stale);
        this.stale = false;
        const goodbye = await this.runConnection(hello);
        if (this.welcomed) attempt = -1;
        if (goodbye && !this.reconnectsAfter(goodbye)) return this.end(goodbye.reason, goodbye.problem);
      } catch (error) {
        const problem = asProblem(error);
        if (problem.status === 429) waitS = Math.ceil(problem.retryAfterS ?? THROTTLED_S);
        else if (error instanceof Problem && !problem.offline && problem.status !== 503) return this.end("refused", problem);
      }
      if (this.closing.signal.aborted) return;
      this.hooks.onState(waitS === null ? { kind: "lost" } : { kind: "lost", waitS });
      const pause = 1000 * (waitS ?? 0) + reconnectDelayMs(attempt, Math.random());
      await sleep(pause, this.closing.signal).catch(() => undefined);
    }
  }

  /** Send a message; false where the connection is down. */
  send(message: ToServer): boolean {
    if (!this.welcomed || this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  close(): void {
    this.closing.abort();
    this.socket?.close();
  }

  private reconnectsAfter({ reason }: Goodbye): boolean {
    this.stale = reason === "given-back";
    return reason === "silent" || reason === "given-back" || reason === "moved";
  }

  private end(reason: Goodbye["reason"], problem: Goodbye["problem"] | Problem): void {
    if (this.closing.signal.aborted) return;
    const told = problem === null || problem instanceof Problem ? problem : Problem.from(problem);
    this.hooks.onState({ kind: "ended", reason, problem: told });
  }

  /** One connection, from hello to its end; returns the server's goodbye if it said one. */
  private runConnection(hello: HelloDetails): Promise<Goodbye | null> {
    const { token, name, after } = hello;
    const socket = this.open(hello.address);
    this.socket = socket;
    this.welcomed = false;
    return new Promise((resolve) => {
      let goodbye: Goodbye | null = null;
      let sentMs: number | null = null;
      let heartbeat: ReturnType<typeof setInterval> | undefined;
      const send = (message: ToServer): void => socket.send(JSON.stringify(message));
      const finish = (): void => {
        clearTimeout(timeout);
        clearInterval(heartbeat);
        if (this.socket === socket) this.socket = null;
        socket.close();
        resolve(goodbye);
      };
      let timeout = setTimeout(finish, CONNECT_TIMEOUT_MS);
      socket.onopen = () => {
        send({ type: "hello", token, name, after });
        heartbeat = setInterval(() => {
          sentMs ??= performance.now();
          send({ type: "beat" });
        }, HEARTBEAT_MS);
      };
      socket.onmessage = ({ data }) => {
        clearTimeout(timeout);
        timeout = setTimeout(finish, HEARTBEAT_TIMEOUT_MS);
        const message = JSON.parse(String(data)) as FromServer;
        if (message.type === "goodbye") goodbye = message;
        else if (message.type === "welcome") {
          this.welcomed = true;
          this.hooks.onState({ kind: "open" });
        }
        if (message.type !== "beat") return this.hooks.onMessage(message);
        if (sentMs !== null) this.hooks.onRoundTrip(performance.now() - sentMs);
        sentMs = null;
      };
      socket.onclose = finish;
      if (this.closing.signal.aborted) finish();
    });
  }
}
