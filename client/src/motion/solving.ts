/** Hands the newest landmarks to the worker that solves poses; none ever waits behind others. */

import type { ObservedExpression } from "../landmarks/expression";
import type { ObservedHead } from "../landmarks/head";
import type { Landmarks } from "../landmarks/landmarks";
import type { SolvedBody } from "./body";

/** What a camera saw at `timeMs`; `liveLook`: whether pictures travel with it. */
export interface SeenPerson {
  seen: Landmarks;
  expression: ObservedExpression | null;
  /** As it was last seen. */
  head: ObservedHead | null;
  timeMs: number;
  liveLook: boolean;
}

export type SolverTask = { kind: "body"; body: SolvedBody } | ({ kind: "seen" } & SeenPerson);

export type SolverMessage =
  | { kind: "ready" }
  /** A motion packet without number and age; null where what was seen tells no pose. */
  | { kind: "solved"; timeMs: number; packet: ArrayBuffer | null }
  | { kind: "failed"; reason: string };

/** As much of a worker as is needed. */
export interface SolverWorker {
  onmessage: ((event: MessageEvent<SolverMessage>) => void) | null;
  onerror: ((event: ErrorEvent) => void) | null;
  postMessage(task: SolverTask): void;
  terminate(): void;
}

export interface SolvingHooks {
  /** The packet of what the camera saw at `timeMs`. */
  onSolved(packet: ArrayBuffer, timeMs: number): void;
  onFailed(reason: string): void;
}

export class PoseSolving {
  private ready = false;
  private busy = false;
  private body: SolvedBody | null = null;
  private waiting: SeenPerson | null = null;

  constructor(
    private readonly hooks: SolvingHooks,
    private readonly worker: SolverWorker = new Worker(new URL("./worker.ts", import.meta.url), { type: "module" }),
  ) {
    worker.onmessage = ({ data }) => this.onMessage(data);
    worker.onerror = (event) => hooks.onFailed(event.message);
  }

  /** Solve poses of this body from now on, from nothing. */
  solveFor(body: SolvedBody): void {
    this.body = body;
    if (this.ready) this.worker.postMessage({ kind: "body", body });
  }

  /** Solve what was seen, or the newest of it once the worker is free; says whether it can be. */
  offer(person: SeenPerson): boolean {
    if (!this.ready || !this.body) return false;
    if (this.busy) this.waiting = person;
    else this.solve(person);
    return true;
  }

  close(): void {
    this.worker.onmessage = this.worker.onerror = null;
    this.ready = false;
    this.worker.terminate();
  }

  private solve(person: SeenPerson): void {
    this.busy = true;
    this.worker.postMessage({ kind: "seen", ...person });
  }

  private onMessage(answer: SolverMessage): void {
    if (answer.kind === "failed") return this.hooks.onFailed(answer.reason);
    if (answer.kind === "ready") {
      this.ready = true;
      if (this.body) this.solveFor(this.body);
      return;
    }
    const { waiting } = this;
    [this.busy, this.waiting] = [false, null];
    if (answer.packet) this.hooks.onSolved(answer.packet, answer.timeMs);
    if (waiting) this.solve(waiting);
  }
}
