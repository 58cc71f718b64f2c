/**
 * Sends a clip in pieces. The server knows it by person and sha256, so that `beginUpload` tells at any time how far it
 * is: after a lost line, a lost answer or a reload of the page.
 */

import type { Hashed } from "./hashWorker";
import { NO_SERVER, Problem, asProblem } from "./problem";
import type { ExistingSequence, NewUpload, Sequence, Upload } from "./types";
import { sleep } from "./until";

export interface HashedClip {
  blob: Blob;
  fileName: string;
  /** Hexadecimal. */
  sha256: string;
}

export interface UploadProgress {
  /** `waiting`: the server is out of reach, and is tried again. */
  phase: "sending" | "waiting";
  /** What the server says that it has, 0 to 1. */
  fraction: number;
}

/** The server's routes for uploads; each throws a Problem, or the reason of `signal`. */
export interface UploadRoutes {
  /** Begin an upload, go on with one of the same bytes, or learn that they are there already. */
  beginUpload(personId: string, clip: NewUpload, signal: AbortSignal): Promise<Upload | ExistingSequence>;
  /** The new offset; of the last piece the sequence. */
  sendPiece(upload: Upload, piece: ArrayBuffer, signal?: AbortSignal): Promise<number | Sequence>;
  deleteUpload(id: string): Promise<void>;
}

export const CLIP_UNREADABLE = new Problem(
  "The clip cannot be read",
  "It may have been moved, changed or deleted since it was chosen. Choose it again.",
);
const CLIP_EMPTY = new Problem("The clip is empty", "The file has 0 bytes. Choose another one.");

/** Up to which a proxy on the way takes a request unless it was told otherwise (nginx). */
const LARGEST_PIECE_BYTES = 1 << 20;
/** So that a slow line moves the bar, and a cut one loses little. */
const SMALLEST_PIECE_BYTES = 1 << 16;
const FIRST_PIECE_BYTES = 1 << 18;
/** How long a piece should take, about. */
const PIECE_MS = 1000;
/** In a row, before it is left to people to try again: about a minute. */
const MOST_FAILURES = 8;
const FIRST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 15_000;
/** Of answers that the same piece may not get another time: somebody else sends too, too many requests, a busy server. */
const PASSING: ReadonlySet<number> = new Set([409, 429, 503]);
const LONGEST_NAME = 255;

/** The sha256 of a clip, found in a worker. Throws CLIP_EMPTY, CLIP_UNREADABLE, or the reason of `signal`. */
export function hashClip(
  clip: Blob,
  signal: AbortSignal,
  worker = new Worker(new URL("./hashWorker.ts", import.meta.url), { type: "module" }),
): Promise<string> {
  return new Promise<string>((resolve, reject) => {
    if (clip.size === 0) reject(CLIP_EMPTY);
    worker.onmessage = ({ data }: MessageEvent<Hashed>) => (data === null ? reject(CLIP_UNREADABLE) : resolve(data));
    worker.onerror = () => reject(NO_SERVER);
    signal.addEventListener("abort", () => reject(signal.reason), { once: true });
    signal.throwIfAborted();
    worker.postMessage(clip);
  }).finally(() => worker.terminate());
}

/**
 * Send `clip` as one of a person's, or what is missing of it. Aborting takes back what was sent and throws the signal's
 * reason; only the answer to the last piece is waited for and returned, since then there is a sequence.
 */
export async function sendClip(
  server: UploadRoutes,
  personId: string,
  clip: HashedClip,
  onProgress: (progress: UploadProgress) => void,
  signal: AbortSignal,
): Promise<Sequence> {
  const sending = new Sending(server, personId, clip, onProgress, signal);
  try {
    return await sending.run();
  } catch (error) {
    if (signal.aborted) await sending.takeBack();
    throw error;
  }
}

class Sending {
  /** As the server last said. */
  private upload: Upload | null = null;
  private isBeginning = true;
  private pieceBytes = FIRST_PIECE_BYTES;

  constructor(
    private readonly server: UploadRoutes,
    private readonly personId: string,
    private readonly clip: HashedClip,
    private readonly onProgress: (progress: UploadProgress) => void,
    private readonly signal: AbortSignal,
  ) {}

  async run(): Promise<Sequence> {
    let [failures, atFailure] = [0, -1];
    for (;;) {
      try {
        const sequence = await this.sendOn();
        if (sequence) return sequence;
      } catch (error) {
        this.signal.throwIfAborted();
        const offset = this.upload?.offset ?? 0;
        if (offset !== atFailure) failures = 0;
        if (!this.passes(error) || failures === MOST_FAILURES) throw error;
        atFailure = offset;
        this.tell("waiting");
        await sleep(pauseMs(failures++, error), this.signal);
      }
    }
  }

  /** Best effort: what stays nevertheless, the server forgets by itself. */
  async takeBack(): Promise<void> {
    if (this.upload) await this.server.deleteUpload(this.upload.id).catch(() => undefined);
  }

  /** From where the server is, as far as it goes. */
  private async sendOn(): Promise<Sequence | null> {
    const { blob, fileName, sha256 } = this.clip;
    const about = { filename: fileName.slice(-LONGEST_NAME), size: blob.size, sha256 };
    this.isBeginning = true;
    const begun = await this.server.beginUpload(this.personId, about, this.signal);
    this.isBeginning = false;
    if ("sequence" in begun) return begun.sequence;
    for (let upload = begun; ; ) {
      this.upload = upload;
      this.tell("sending");
      const answer = await this.sendPiece(upload);
      if (typeof answer !== "number") return answer;
      upload = { ...upload, offset: answer };
    }
  }

  private async sendPiece(upload: Upload): Promise<number | Sequence> {
    const end = upload.offset + this.pieceBytes;
    // read first: fetch would take a file that has gone for a lost line
    const piece = await this.clip.blob.slice(upload.offset, end).arrayBuffer().catch(() => { throw CLIP_UNREADABLE; });
    const isLast = end >= this.clip.blob.size;
    const began = performance.now();
    const answer = await this.server.sendPiece(upload, piece, isLast ? undefined : this.signal);
    const tookMs = performance.now() - began;
    if (tookMs < PIECE_MS / 2) this.pieceBytes = Math.min(2 * this.pieceBytes, LARGEST_PIECE_BYTES);
    else if (tookMs > 2 * PIECE_MS) this.pieceBytes = Math.max(this.pieceBytes / 2, SMALLEST_PIECE_BYTES);
    return answer;
  }

  /** Whether the same may well succeed later. */
  private passes(error: unknown): boolean {
    if (!(error instanceof Problem)) return false;
    const { offline, status } = error;
    // a piece's 404: the upload has ended, by age or because all of it came though the answer was lost; beginning tells
    return offline || PASSING.has(status) || (status === 404 && !this.isBeginning);
  }

  private tell(phase: UploadProgress["phase"]): void {
    this.onProgress({ phase, fraction: (this.upload?.offset ?? 0) / this.clip.blob.size });
  }
}

function pauseMs(failures: number, error: unknown): number {
  const asked = 1000 * (asProblem(error).retryAfterS ?? 0);
  return Math.max(asked, Math.min(FIRST_PAUSE_MS * 2 ** failures, LONGEST_PAUSE_MS));
}
