/**
 * Improving one's model from inside a meeting: a short film, its capture, and a training that goes
 * on from the model that stands there. Holds one state and tells each change of it; all of it can be
 * taken back at any moment. Knows nothing of the page.
 */

import { isFinal, type Api } from "../api/api";
import type { Step } from "./enrol";
import { Problem, asProblem } from "../api/problem";
import type { UploadProgress } from "../api/upload";
import { UPLOAD_WORDS } from "./uploadWords";
import { advice } from "./quality";
import type { RecordedClip } from "../capture/record";
import type { Job, NewModel, Performer, Sequence } from "../api/types";

export const CLIP_S = 10;

export type ImproveState =
  | { kind: "off" }
  /** `second` is below zero while one gets ready. */
  | { kind: "filming"; second: number }
  | { kind: "working"; step: Step; fraction: number; message: string; job: Job | null }
  | { kind: "stopping" }
  /** Taken back. `learnt`: a version of it stands in the meeting already; `left`: its film is still on the server. */
  | { kind: "stopped"; improved: boolean; clipOnServer: boolean }
  | { kind: "better"; advice: string[] }
  | { kind: "failed"; problem: Problem; advice: string[]; clipOnServer: boolean };

/** Somebody of ours in the meeting whose model can be gone on from. */
export interface Improvable {
  performerId: string;
  personId: string;
  modelId: string;
  name: string;
}

/** Sequences of films whose pictures may still lie on the server; outlives the page. */
export interface PendingDeletions {
  get(): string[];
  set(ids: string[]): void;
}

const TRAINING = { preset: "splats", seed: 0, model_only: true } satisfies NewModel;
const NO_RETAKE_NEEDED = "Nothing needs to be filmed again.";
const NOT_HERE = new Problem(
  "Your model is no longer in this meeting",
  "Rejoin the meeting, then try again.",
);
const LEFT = new DOMException("left", "AbortError");

/** Performers of our own people who are drawn by splats; none for who was only invited to look. */
export async function improvable(api: Api, performers: readonly Performer[]): Promise<Improvable[]> {
  try {
    const [people, models] = await Promise.all([api.people(), api.models()]);
    const ours = new Set(people.filter(({ mine }) => mine).map(({ id }) => id));
    return performers.flatMap(({ id, name, model_id }) => {
      const model = models.find((one) => one.id === model_id);
      const fits = model?.preset === "splats" && ours.has(model.person_id);
      return fits ? [{ performerId: id, personId: model.person_id, modelId: model.id, name }] : [];
    });
  } catch (error) {
    if (error instanceof Problem && error.status === 403) return [];
    throw error;
  }
}

export class ModelImprovement {
  state: ImproveState = { kind: "off" };
  private cancelling = new AbortController();
  private running: Promise<void> = Promise.resolve();

  constructor(
    private readonly api: Api,
    private readonly pendingDeletions: PendingDeletions,
    private readonly onChange: (state: ImproveState) => void,
  ) {}

  /**
   * Film somebody and learn from it. `film` gives the clip and tells each moment of it; `currentModelId` is
   * the model that stands for them when the training begins; null: they have left.
   */
  start(
    personId: string,
    currentModelId: () => string | null,
    film: (onSecond: (second: number) => void, signal: AbortSignal) => Promise<RecordedClip>,
  ): Promise<void> {
    this.cancelling = new AbortController();
    this.running = this.attempt(this.cancelling.signal, async (work, signal) => {
      const clip = await film((second) => signal.aborted || this.change({ kind: "filming", second }), signal);
      signal.throwIfAborted();
      work.sequence = await this.upload(personId, clip, signal);
      signal.throwIfAborted();
      work.sequence = await this.capture(work.sequence, work, signal);
      signal.throwIfAborted();
      const improves = currentModelId();
      if (improves === null) throw NOT_HERE;
      work.job = await this.api.train(work.sequence.id, { ...TRAINING, improves });
      signal.throwIfAborted();
      await this.follow("train", work.job, work, signal);
    });
    return this.running;
  }

  /** Take everything back: no more filming, no upload, no job, no clip. */
  async cancel(): Promise<void> {
    if (this.state.kind === "filming" || this.state.kind === "working") {
      this.cancelling.abort(new DOMException("taken back", "AbortError"));
      this.change({ kind: "stopping" });
      await this.running;
    } else if (this.state.kind !== "stopping") this.change({ kind: "off" });
  }

  /** Whoever leaves takes back what is not being learnt yet; what is, the server finishes and forgets. */
  async leave(): Promise<void> {
    if (this.state.kind === "working" && this.state.step === "train") this.cancelling.abort(LEFT);
    else await this.cancel();
  }

  /** Remove what an earlier visit could not. */
  async deletePending(): Promise<void> {
    for (const id of this.pendingDeletions.get()) await this.remove(id, null);
  }

  private async upload(personId: string, { blob, fileName }: RecordedClip, signal: AbortSignal): Promise<Sequence> {
    this.working("upload", 0, null, UPLOAD_WORDS.hashing);
    const clip = await this.api.hashClip(blob, fileName, signal);
    const onProgress = ({ phase, fraction }: UploadProgress): void =>
      this.working("upload", fraction, null, UPLOAD_WORDS[phase]);
    const sequence = await this.api.uploadSequence(personId, clip, onProgress, signal);
    this.pendingDeletions.set([...this.pendingDeletions.get(), sequence.id]);
    return sequence;
  }

  private async capture({ id, job_id }: Sequence, work: Work, signal: AbortSignal): Promise<Sequence> {
    if (job_id !== null) await this.follow("capture", await this.api.job(job_id), work, signal);
    return this.api.sequence(id);
  }

  /** Tell a job's progress until it ends well. */
  private async follow(step: Step, started: Job, work: Work, signal: AbortSignal): Promise<void> {
    const news = (job: Job): void => {
      work.job = job;
      this.working(step, Math.min(1, Math.max(0, job.progress)), job);
    };
    news(started);
    const { state, error, message } = await this.api.watchJob(started.id, news, signal);
    if (state === "succeeded") return;
    throw error ? Problem.from(error) : new Problem("The job failed", message, 500);
  }

  private working(step: Step, fraction: number, job: Job | null, message = job?.message ?? ""): void {
    if (!this.cancelling.signal.aborted) this.change({ kind: "working", step, fraction, message, job });
  }

  private async attempt(signal: AbortSignal, run: (work: Work, signal: AbortSignal) => Promise<void>): Promise<void> {
    const work: Work = { sequence: null, job: null };
    this.change({ kind: "filming", second: -Infinity });
    try {
      await run(work, signal);
      this.forgetPending(work.sequence?.id);
      this.change({ kind: "better", advice: retakeAdvice(work.sequence) });
    } catch (error) {
      if (signal.reason === LEFT) return;
      const learning = work.job?.kind === "train" ? work.job : null;
      const gone = work.sequence === null || (await this.remove(work.sequence.id, learning));
      // what was learnt until the end is known only then
      const improved = learning !== null && (await this.hasModel(learning));
      if (signal.aborted) this.change({ kind: "stopped", improved, clipOnServer: !gone });
      else this.change({ kind: "failed", problem: asProblem(error), advice: retakeAdvice(work.sequence), clipOnServer: !gone });
    }
  }

  private async hasModel(training: Job): Promise<boolean> {
    const latest = await this.api.job(training.id).catch(() => training);
    return latest.model_id !== null;
  }

  /** Take a film from the server, with whatever works on it; false where that must wait. */
  private async remove(id: string, training: Job | null): Promise<boolean> {
    try {
      const { state, job_id } = await this.api.sequence(id);
      const capturing = state === "uploaded" || state === "capturing";
      // cancelling a capture removes its clip
      const gone = capturing && (await this.endJob(job_id)) === "cancelled";
      if (training) await this.endJob(training.id);
      // once learnt, its pictures are gone already
      if (!gone && state !== "forgotten") await this.api.deleteSequence(id);
    } catch (error) {
      // 404: removed elsewhere; 403: another account's, from an earlier visit
      const settled = error instanceof Problem && [403, 404].includes(error.status);
      if (!settled) return false;
    }
    this.forgetPending(id);
    return true;
  }

  /** Cancel a job, and wait until nobody works on it; its state then. */
  private async endJob(jobId: string | null): Promise<Job["state"] | null> {
    if (!jobId) return null;
    const job = await this.api.job(jobId);
    if (isFinal(job)) return job.state;
    await this.api.cancelJob(jobId).catch((error: unknown) => {
      // 409: it has just ended by itself
      if (!(error instanceof Problem) || error.status !== 409) throw error;
    });
    return (await this.api.watchJob(jobId, () => undefined, new AbortController().signal)).state;
  }

  private forgetPending(id: string | undefined): void {
    this.pendingDeletions.set(this.pendingDeletions.get().filter((other) => other !== id));
  }

  private change(state: ImproveState): void {
    this.state = state;
    this.onChange(state);
  }
}

/** What has come of a film so far. */
interface Work {
  sequence: Sequence | null;
  job: Job | null;
}

function retakeAdvice(sequence: Sequence | null): string[] {
  return sequence ? advice(sequence).filter((line) => line !== NO_RETAKE_NEEDED) : [];
}
