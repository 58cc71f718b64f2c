/**
 * The control channel: a WebSocket that says hello with the seat's token, beats once a second, and
 * comes back by itself after a cut, until it is closed or the server says goodbye for good.
 */

import { sleep } from "../api/api";
import { Problem, asProblem } from "../api/problem";
import type { FromServer, Goodbye, ToServer } from "../api/types";

export type ControlState =
  | { kind: "connecting" }
  | { kind: "open" }
  | { kind: "lost" }
  | { kind: "over"; reason: Goodbye["reason"]; problem: Problem | null };

export interface Greeting {
  address: string;
  token: string;
  name: string;
  /** Number of the newest message that has come. */
  after: number;
}

export interface ControlHooks {
  /** Whose seat to take up; `stale` when the last one was given back. */
  greeting(stale: boolean): Promise<Greeting>;
  onMessage(message: FromServer): void;
  onState(state: ControlState): void;
  /** A beat has come back. */
  onRoundTrip(milliseconds: number): void;
}

const BEAT_MS = 1000;
/** The server's own patience, too: no answer for so long and the line is cut. */
const SILENCE_MS = 5000;
const CONNECTING_MS = 3000;
const LONGEST_PAUSE_MS = 1000;

/** The pause before attempt `attempt` (from 0): short, so that a meeting is back within seconds. */
export function pauseMs(attempt: number, random: number): number {
  return Math.min(LONGEST_PAUSE_MS, 150 * 2 ** attempt) * (0.75 + 0.25 * random);
}

export class ControlConnection {
  private readonly closing = new AbortController();
  private socket: WebSocket | null = null;
  private greeted = false;
  private stale = false;

  constructor(
    private readonly hooks: ControlHooks,
    private readonly open: (address: string) => WebSocket = (address) => new WebSocket(address),
  ) {}

  /** Connect and stay connected; returns when closed or over. */
  async run(): Promise<void> {
    this.hooks.onState({ kind: "connecting" });
    for (let attempt = 0; !this.closing.signal.aborted; attempt++) {
      try {
        const greeting = await this.hooks.greeting(this.stale);
        this.stale = false;
        const goodbye = await this.talk(greeting);
        if (this.greeted) attempt = -1;
        if (goodbye && !this.comesBack(goodbye)) return this.over(goodbye.reason, goodbye.problem);
      } catch (error) {
        const problem = asProblem(error);
        if (!problem.offline && problem.status !== 503) return this.over("refused", problem);
      }
      if (this.closing.signal.aborted) return;
      this.hooks.onState({ kind: "lost" });
      const pause = pauseMs(attempt, Math.random());
      await sleep(pause, this.closing.signal).catch(() => undefined);
    }
  }

  /** Send a message; false where the line is down. */
  send(message: ToServer): boolean {
    if (!this.greeted || this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  close(): void {
    this.closing.abort();
    this.socket?.close();
  }

  private comesBack({ reason }: Goodbye): boolean {
    this.stale = reason === "given-back";
    return reason === "silent" || reason === "given-back";
  }

  private over(reason: Goodbye["reason"], problem: Goodbye["problem"] | Problem): void {
    if (this.closing.signal.aborted) return;
    const told = problem === null || problem instanceof Problem ? problem : Problem.from(problem);
    this.hooks.onState({ kind: "over", reason, problem: told });
  }

  /** One connection, from hello to its end; returns the server's goodbye if it said one. */
  private talk(greeting: Greeting): Promise<Goodbye | null> {
    const { token, name, after } = greeting;
    const socket = this.open(greeting.address);
    this.socket = socket;
    this.greeted = false;
    return new Promise((resolve) => {
      let goodbye: Goodbye | null = null;
      let beatMs: number | null = null;
      let beating: ReturnType<typeof setInterval> | undefined;
      const say = (message: ToServer): void => socket.send(JSON.stringify(message));
      const finish = (): void => {
        clearTimeout(patience);
        clearInterval(beating);
        if (this.socket === socket) this.socket = null;
        socket.close();
        resolve(goodbye);
      };
      let patience = setTimeout(finish, CONNECTING_MS);
      socket.onopen = () => {
        say({ type: "hello", token, name, after });
        beating = setInterval(() => {
          beatMs ??= performance.now();
          say({ type: "beat" });
        }, BEAT_MS);
      };
      socket.onmessage = ({ data }) => {
        clearTimeout(patience);
        patience = setTimeout(finish, SILENCE_MS);
        const message = JSON.parse(String(data)) as FromServer;
        if (message.type === "goodbye") goodbye = message;
        else if (message.type === "welcome") {
          this.greeted = true;
          this.hooks.onState({ kind: "open" });
        }
        if (message.type !== "beat") return this.hooks.onMessage(message);
        if (beatMs !== null) this.hooks.onRoundTrip(performance.now() - beatMs);
        beatMs = null;
      };
      socket.onclose = finish;
      if (this.closing.signal.aborted) finish();
    });
  }
}
