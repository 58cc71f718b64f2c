import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { NO_SERVER, Problem } from "../../src/api/problem";
import type { ExistingSequence, NewUpload, Sequence, Upload } from "../../src/api/types";
import { hashClip, sendClip, type UploadProgress, type UploadRoutes } from "../../src/api/upload";
import { hashClip as hashClipHere, sequence, sha256 } from "../fakes";

const KIB = 1 << 10;
/** Four pieces on a fast line. */
const BYTES = Uint8Array.from({ length: 2816 * KIB }, (_, i) => (i >> 10) & 255);
const CLIP = await hashClipHere(new Blob([BYTES]), "me.mp4");
const GONE = new Problem("Not found", "", 404);

/** A server that keeps what comes; `mishap` happens to the piece that is the so-many-eth to be sent. */
class FakeServer implements UploadRoutes {
  upload: Upload | null = null;
  kept: ArrayBuffer[] = [];
  offsets: number[] = [];
  sizes: number[] = [];
  begun: NewUpload[] = [];
  deleted: string[] = [];
  whole: Sequence | null = null;
  mishaps = new Map<number, (piece: ArrayBuffer) => void | Promise<void>>();
  pieceMs = 0;

  async beginUpload(_person: string, clip: NewUpload): Promise<Upload | ExistingSequence> {
    this.begun.push(clip);
    if (this.whole) return { sequence: this.whole };
    return { ...(this.upload ??= { id: `u${this.begun.length}`, offset: 0 }) };
  }
  async sendPiece(upload: Upload, piece: ArrayBuffer, signal?: AbortSignal): Promise<number | Sequence> {
    this.offsets.push(upload.offset);
    this.sizes.push(piece.byteLength);
    await new Promise((resolve) => setTimeout(resolve, this.pieceMs));
    await this.mishaps.get(this.offsets.length - 1)?.(piece);
    signal?.throwIfAborted();
    return this.keep(piece);
  }
  async deleteUpload(id: string): Promise<void> {
    this.deleted.push(id);
  }
  keep(piece: ArrayBuffer): number | Sequence {
    if (!this.upload) throw GONE;
    this.kept.push(piece);
    this.upload.offset += piece.byteLength;
    if (this.upload.offset < BYTES.length) return this.upload.offset;
    return (this.whole = sequence());
  }
  received(): Promise<string> {
    return sha256(new Blob(this.kept));
  }
}

function setUp(mishaps: [number, (piece: ArrayBuffer) => void | Promise<void>][] = []) {
  const [server, stopping, told] = [new FakeServer(), new AbortController(), [] as UploadProgress[]];
  server.mishaps = new Map(mishaps);
  const send = (): Promise<Sequence> => sendClip(server, "p", CLIP, (progress) => told.push(progress), stopping.signal);
  return { server, stopping, told, send };
}

/** Let time go by until `work` ends; its error is its outcome. */
async function outcome<T>(work: Promise<T>): Promise<T | unknown> {
  const ended = work.catch((error: unknown) => error);
  await vi.runAllTimersAsync();
  return ended;
}

beforeEach(() => void vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "performance"] }));
afterEach(() => void vi.useRealTimers());

describe("sendClip", () => {
  it("sends every byte once, in order, and tells how far the server is", async () => {
    const { server, told, send } = setUp();
    expect(await outcome(send())).toEqual(sequence());
    expect(await server.received()).toBe(CLIP.sha256);
    expect(server.begun).toEqual([{ filename: "me.mp4", size: BYTES.length, sha256: CLIP.sha256 }]);
    expect(told.map(({ fraction }) => fraction)).toEqual(server.offsets.map((offset) => offset / BYTES.length));
    expect(new Set(told.map(({ phase }) => phase))).toEqual(new Set(["sending"]));
  });

  it("fits its pieces to the line", async () => {
    const fast = setUp();
    await outcome(fast.send());
    expect(fast.server.sizes.slice(0, 3)).toEqual([256 * KIB, 512 * KIB, 1024 * KIB]);
    const slow = setUp();
    slow.server.pieceMs = 3000;
    await outcome(slow.send());
    expect(slow.server.sizes.slice(0, 4)).toEqual([256 * KIB, 128 * KIB, 64 * KIB, 64 * KIB]);
  });

  it("goes on after a lost line from what the server kept of the piece", async () => {
    const { server, told, send } = setUp();
    server.mishaps.set(1, (piece) => {
      server.keep(piece.slice(0, 100));
      throw NO_SERVER;
    });
    await outcome(send());
    expect(server.offsets[2]).toBe(256 * KIB + 100);
    expect(await server.received()).toBe(CLIP.sha256);
    expect(told.filter(({ phase }) => phase === "waiting")).toEqual([{ phase: "waiting", fraction: (256 * KIB) / BYTES.length }]);
  });

  it("waits longer and longer for a server that stays away, and gives up in the end", async () => {
    const { server, told, send } = setUp();
    const times: number[] = [];
    server.beginUpload = async () => {
      times.push(performance.now());
      throw NO_SERVER;
    };
    expect(await outcome(send())).toBe(NO_SERVER);
    const waits = times.slice(1).map((time, i) => Math.round(time - (times[i] ?? 0)));
    expect(waits).toEqual([500, 1000, 2000, 4000, 8000, 15_000, 15_000, 15_000]);
    expect(told.at(-1)).toEqual({ phase: "waiting", fraction: 0 });
  });

  it("does not lose patience while something comes through", async () => {
    const fails = (): never => {
      throw NO_SERVER;
    };
    const pieces = Array.from({ length: 20 }, (_, i) => [i, (piece: ArrayBuffer) => (server.keep(piece.slice(0, 1)), fails())] as const);
    const { server, send } = setUp();
    server.mishaps = new Map(pieces);
    expect(await outcome(send())).toEqual(sequence());
    expect(server.offsets.slice(0, 3)).toEqual([0, 1, 2]);
  });

  it("waits as long as a busy server asks", async () => {
    const { server, send } = setUp();
    let retriedMs = 0;
    server.mishaps.set(0, () => {
      throw new Problem("Too many requests", "", 429, 40);
    });
    server.mishaps.set(1, () => void (retriedMs = performance.now()));
    const beganMs = performance.now();
    await outcome(send());
    expect(retriedMs - beganMs).toBe(40_000);
  });

  it("learns that all had come where only the answer was lost", async () => {
    const { server, send } = setUp();
    server.mishaps.set(3, (piece) => {
      server.keep(piece);
      throw NO_SERVER;
    });
    expect(await outcome(send())).toEqual(sequence());
    expect(server.offsets).toHaveLength(4);
  });

  it("completes an upload of which the server has every byte and no sequence", async () => {
    const { server, send } = setUp();
    server.upload = { id: "u", offset: BYTES.length };
    expect(await outcome(send())).toEqual(sequence());
    expect(server.sizes).toEqual([0]);
  });

  it("begins anew where the server has given the upload up meanwhile", async () => {
    const { server, send } = setUp();
    server.mishaps.set(1, () => {
      Object.assign(server, { upload: null, kept: [] });
      throw GONE;
    });
    await outcome(send());
    expect(server.offsets.slice(0, 3)).toEqual([0, 256 * KIB, 0]);
    expect(await server.received()).toBe(CLIP.sha256);
  });

  it.each([
    ["too large", 413],
    ["of a person who is gone", 404],
  ])("throws at once what the server says of a clip that is %s", async (_, status) => {
    const { server, send } = setUp();
    const refusal = new Problem("Refused", "Because.", status);
    server.beginUpload = () => Promise.reject(refusal);
    expect(await outcome(send())).toBe(refusal);
    expect(server.offsets).toEqual([]);
  });

  it.each([
    ["a clip of the wrong type", 422],
    ["a full disk", 507],
  ])("throws at once what the server says of %s", async (_, status) => {
    const { server, send } = setUp();
    const refusal = new Problem("Refused", "Because.", status);
    server.mishaps.set(2, () => Promise.reject(refusal));
    expect(await outcome(send())).toBe(refusal);
    expect(server.offsets).toHaveLength(3);
  });

  it("says that a file cannot be read any more, and does not take it for a lost line", async () => {
    const { server, stopping } = setUp();
    const blob = { size: 10, slice: () => ({ arrayBuffer: () => Promise.reject(new DOMException("", "NotReadableError")) }) };
    const sending = sendClip(server, "p", { ...CLIP, blob: blob as unknown as Blob }, () => undefined, stopping.signal);
    expect(await outcome(sending)).toMatchObject({ title: "The clip cannot be read" });
  });

  it("takes back what it sent when it is stopped", async () => {
    const { server, stopping, send } = setUp();
    server.mishaps.set(1, () => stopping.abort("stopped"));
    expect(await outcome(send())).toBe("stopped");
    expect([server.offsets.length, server.deleted]).toEqual([2, ["u1"]]);
  });

  it("stops while it waits", async () => {
    const { server, stopping, send } = setUp();
    server.mishaps.set(1, () => {
      setTimeout(() => stopping.abort("stopped"), 100);
      throw NO_SERVER;
    });
    expect(await outcome(send())).toBe("stopped");
    expect([server.offsets.length, server.deleted]).toEqual([2, ["u1"]]);
  });

  it("hands over the sequence where it was stopped during the last piece", async () => {
    const { server, stopping, send } = setUp();
    server.mishaps.set(3, () => stopping.abort("stopped"));
    expect(await outcome(send())).toEqual(sequence());
    expect(server.deleted).toEqual([]);
  });
});

describe("hashClip", () => {
  class FakeWorker {
    onmessage: (event: { data: string | null }) => void = () => undefined;
    onerror: () => void = () => undefined;
    given: Blob[] = [];
    ended = false;
    postMessage(clip: Blob): void {
      this.given.push(clip);
    }
    terminate(): void {
      this.ended = true;
    }
  }

  function hashing(clip = CLIP.blob) {
    const [worker, stopping] = [new FakeWorker(), new AbortController()];
    const work = hashClip(clip, stopping.signal, worker as unknown as Worker);
    return { worker, stopping, work: work.catch((error: unknown) => error) };
  }

  it("has a worker do it, which ends with it", async () => {
    const { worker, work } = hashing();
    worker.onmessage({ data: "abc" });
    expect([await work, worker.given, worker.ended]).toEqual(["abc", [CLIP.blob], true]);
  });

  it("says what is wrong with a clip", async () => {
    expect(await hashing(new Blob()).work).toMatchObject({ title: "The clip is empty" });
    const { worker, work } = hashing();
    worker.onmessage({ data: null });
    expect(await work).toMatchObject({ title: "The clip cannot be read" });
  });

  it("stops when told to", async () => {
    const { worker, stopping, work } = hashing();
    stopping.abort("stopped");
    expect([await work, worker.ended]).toEqual(["stopped", true]);
  });
});
