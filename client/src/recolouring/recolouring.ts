/** How people with live look look now, in a room that this device draws: shown with each picture, gone at its end. */

import type { SplatFile } from "../splats/file";
import type { LaidPicture } from "../splats/laid";
import { decodeLook, type LookFrame, type LookPose } from "./packets";
import type { LookTask, Recoloured } from "./worker";

/** Without a word for so long it is no longer how they look. */
const SILENCE_MS = 1000;
/** Motion waits no longer for its picture. */
const MOST_BEHIND_MS = 300;
const USUAL_SHARE = 0.1;

/** Who is drawn; see `LocalRoom`. */
export interface RecolouredRoom {
  /** Everybody's splats, one person after the other. */
  readonly people: readonly SplatFile[];
  /** Whether it takes pictures to lay on people. */
  readonly lays: boolean;
  /** The place of whom the server means by `check`; -1: nobody of that is drawn. */
  indexOf(check: number): number;
  /** `laid`: of each person; null: nothing is laid on them. */
  setChanges(changes: Uint32Array, laid: readonly (LaidPicture | null)[]): void;
}

/** One person with live look. */
interface Shown {
  splats: SplatFile;
  version: number;
  /** What their newest picture changes, and the picture as it is laid on them. */
  seen: Pick<Recoloured, "changes" | "laid"> | null;
  heardMs: number;
  /** How long ago the shown moment came by the channel of poses, ms. */
  behindMs: number | null;
}

export class Recolouring {
  private readonly shown = new Map<number, Shown>();
  private versions = 0;
  private worker: Worker | null = null;
  /** From a pose's moment, by the server's clock, to when it came here. */
  private poseDelayMs: number | null = null;

  /** `room`: what is drawn now; null: nothing. */
  constructor(private readonly room: () => RecolouredRoom | null) {}

  /** Take a packet of the channel `look`. */
  accept(bytes: ArrayBuffer, nowMs: number): void {
    const packet = decodeLook(bytes);
    if (!packet) return;
    if (packet.kind === "end") this.end(packet.check);
    else this.receive(packet, nowMs);
  }

  /** A pose that was captured at `capturedMs` of the server's clock came. */
  notePose(capturedMs: number, nowMs: number): void {
    const delay = nowMs - capturedMs;
    this.poseDelayMs = this.poseDelayMs === null ? delay : this.poseDelayMs + USUAL_SHARE * (delay - this.poseDelayMs);
  }

  /** How much later than it comes the motion of whom the server means by `check` is to be shown, ms. */
  behindMs(check: number): number {
    return this.shown.get(check)?.behindMs ?? 0;
  }

  /** End what nothing is heard of any more. */
  update(nowMs: number): void {
    for (const [check, one] of this.shown) {
      if (nowMs - one.heardMs > SILENCE_MS) this.end(check);
    }
  }

  /** Another connection, or another room is drawn: nothing of before is shown. */
  forget(): void {
    for (const check of [...this.shown.keys()]) this.end(check);
    this.poseDelayMs = null;
  }

  close(): void {
    this.worker?.terminate();
    this.worker = null;
  }

  private receive(packet: LookFrame | LookPose, nowMs: number): void {
    const room = this.room();
    const splats = room?.people[room.indexOf(packet.check)];
    if (!room || !splats) return;
    const one = this.shown.get(packet.check);
    if (!one || one.splats !== splats) {
      this.versions += 1;
      const version = this.versions;
      this.shown.set(packet.check, { splats, version, seen: null, heardMs: nowMs, behindMs: one?.behindMs ?? null });
      this.tell({ person: packet.check, splats, version });
    } else one.heardMs = nowMs;
    this.tell({ person: packet.check, packet, lays: room.lays });
  }

  private end(check: number): void {
    const one = this.shown.get(check);
    if (!one) return;
    this.shown.delete(check);
    this.tell({ person: check, ended: true });
    if (one.seen) this.show();
  }

  private tell(task: LookTask): void {
    this.worker ??= this.begin();
    this.worker.postMessage(task);
  }

  private begin(): Worker {
    const worker = new Worker(new URL("./worker.ts", import.meta.url), { type: "module" });
    worker.addEventListener("message", ({ data }: MessageEvent<Recoloured>) => this.onRecoloured(data, performance.now()));
    return worker;
  }

  private onRecoloured({ person, version, changes, laid, momentMs }: Recoloured, nowMs: number): void {
    const one = this.shown.get(person);
    if (one?.version !== version || changes.length !== one.splats.count) return; // ended, or drawn by others, meanwhile
    one.seen = { changes, laid };
    if (this.poseDelayMs !== null) {
      const late = Math.max(0, Math.min(nowMs - momentMs - this.poseDelayMs, MOST_BEHIND_MS));
      one.behindMs = one.behindMs === null ? late : one.behindMs + USUAL_SHARE * (late - one.behindMs);
    }
    this.show();
  }

  /** Hand everybody's changes, and what is laid on them, to the card. */
  private show(): void {
    const room = this.room();
    if (!room) return;
    const all = new Uint32Array(room.people.reduce((sum, { count }) => sum + count, 0));
    const laid = room.people.map((): LaidPicture | null => null);
    for (const [check, { splats, seen }] of this.shown) {
      const index = room.indexOf(check);
      if (!seen || room.people[index] !== splats) continue;
      laid[index] = seen.laid;
      all.set(seen.changes, room.people.slice(0, index).reduce((sum, { count }) => sum + count, 0));
    }
    room.setChanges(all, laid);
  }
}
