/**
 * From a clip to a model: upload, capture, training. Holds one state and tells each change of it;
 * knows nothing of the page.
 */

import type { Api } from "../api/api";
import { isFinal } from "../api/api";
import { MOTION_ONLY } from "./keypoints";
import { Problem, asProblem } from "../api/problem";
import type { Job, ListedPerson, NewModel, NewPerson, Sequence } from "../api/types";
import type { UploadProgress } from "../api/upload";
import { UPLOAD_WORDS } from "./uploadWords";

export type Step = "upload" | "capture" | "train";

export interface EnrolState {
  step: Step;
  status: "working" | "stopping" | "stopped" | "failed" | "ready";
  /** Of the present step, 0 to 1. */
  fraction: number;
  /** What the server says that it is doing. */
  message: string;
  name: string;
  sequence: Sequence | null;
  /** The job of the present step, newest news. */
  job: Job | null;
  modelId: string | null;
  problem: Problem | null;
}

/** Enough to go on after the page was reloaded. */
export interface Bookmark {
  name: string;
  sequenceId: string;
  /** The training, once it is queued. */
  jobId: string | null;
  /** Whether the clip goes once the model is there. */
  modelOnly?: boolean;
}

export interface Clip {
  blob: Blob;
  fileName: string;
  /** Whether the clip is to be deleted once the model is trained. */
  modelOnly?: boolean;
  /** A video to look at, where the clip itself is none. */
  preview?: Blob;
}

/** Whom each clip that is not sent whole yet was begun for, by its sha256; outlives the page. */
export interface UploadsUnderWay {
  get(sha256: string): string | null;
  set(sha256: string, personId: string | null): void;
}

const UPLOAD_KEY = "metanerf.upload.";

export const browserUploads: UploadsUnderWay = {
  get: (sha256) => localStorage.getItem(UPLOAD_KEY + sha256),
  set: (sha256, personId) => {
    if (personId === null) localStorage.removeItem(UPLOAD_KEY + sha256);
    else localStorage.setItem(UPLOAD_KEY + sha256, personId);
  },
};

const TRAINING: NewModel = { preset: "splats", seed: 0 };

export class Enrolment {
  state: EnrolState = {
    step: "upload",
    status: "working",
    fraction: 0,
    message: "",
    name: "",
    sequence: null,
    job: null,
    modelId: null,
    problem: null,
  };
  private working = new AbortController();
  private bookmark: Bookmark | null = null;
  private begun: { newcomer: NewPerson; clip: Clip } | null = null;
  private modelOnly = false;

  constructor(
    private readonly api: Api,
    private readonly onChange: (state: EnrolState) => void,
    private readonly onBookmark: (bookmark: Bookmark | null) => void,
    private readonly uploads: UploadsUnderWay,
  ) {}

  /** Upload `clip` as a new person and see it through to a model; an upload that was cut off is gone on with. */
  start(newcomer: NewPerson, clip: Clip): Promise<void> {
    this.modelOnly = clip.modelOnly ?? false;
    this.begun = { newcomer, clip };
    return this.attempt(async (signal) => {
      this.change({ name: newcomer.name, step: "upload", status: "working", fraction: 0, message: UPLOAD_WORDS.hashing, problem: null });
      const hashed = await this.api.hashClip(clip.blob, clip.fileName, signal);
      const personId = await this.personOf(newcomer, hashed.sha256);
      try {
        signal.throwIfAborted();
        const onProgress = ({ phase, fraction }: UploadProgress): void =>
          signal.aborted ? undefined : this.change({ fraction, message: UPLOAD_WORDS[phase] });
        const sequence = await this.api.uploadSequence(personId, hashed, onProgress, signal);
        signal.throwIfAborted();
        this.uploads.set(hashed.sha256, null);
        await this.captureAndTrain(sequence, signal);
        if (this.state.status === "stopped" && !this.canResume) this.erasePerson(personId);
      } catch (error) {
        if (this.leftNoClip(error, signal)) {
          this.uploads.set(hashed.sha256, null);
          this.erasePerson(personId);
        }
        throw error;
      }
    });
  }

  /** Go on where an earlier visit to the page stopped looking. */
  continueFrom(bookmark: Bookmark): Promise<void> {
    this.modelOnly = bookmark.modelOnly ?? false;
    return this.attempt(async (signal) => {
      this.setBookmark(bookmark);
      this.change({ name: bookmark.name, step: "capture", status: "working", problem: null });
      const sequence = await this.api.sequence(bookmark.sequenceId);
      signal.throwIfAborted();
      await this.captureAndTrain(sequence, signal);
    });
  }

  /** Stop what is being done; a stopped training can be resumed. */
  async cancel(): Promise<void> {
    const { job, step } = this.state;
    if (step === "upload" || !job) {
      this.working.abort(new DOMException("stopped", "AbortError"));
      this.change({ status: "stopped" });
      return;
    }
    this.change({ status: "stopping" });
    try {
      await this.api.cancelJob(job.id);
    } catch (error) {
      // it may have ended by itself meanwhile; then its end is what counts
      if (this.state.status === "stopping") this.change({ status: "working" });
      if (!(error instanceof Problem) || error.offline) throw error;
    }
  }

  get canResume(): boolean {
    const { status, job } = this.state;
    const ended = status === "stopped" || status === "failed";
    // a job whose clip the server has given up has no sequence any more
    return ended && !!job?.sequence_id && isFinal(job) && job.state !== "succeeded";
  }

  /** The server went out of sight, but it has the clip, or we have: the way can be taken up again. */
  get canReconnect(): boolean {
    return this.state.status === "failed" && this.state.problem?.offline === true && !!(this.bookmark ?? this.begun);
  }

  reconnect(): Promise<void> {
    if (this.bookmark) return this.continueFrom(this.bookmark);
    return this.begun ? this.start(this.begun.newcomer, this.begun.clip) : Promise.resolve();
  }

  /** Take up a stopped or failed job again: a training from its last checkpoint. */
  resume(): Promise<void> {
    const { job, sequence } = this.state;
    if (!job) return Promise.resolve();
    return this.attempt(async (signal) => {
      this.change({ status: "working", problem: null });
      const resumed = await this.api.resumeJob(job.id);
      if (job.kind === "capture" && sequence) await this.captureAndTrain(sequence, signal);
      else await this.follow(resumed, signal);
    });
  }

  /** Stop listening; the server's work goes on. */
  leave(): void {
    this.working.abort(new DOMException("left", "AbortError"));
  }

  /** Who was made for an earlier attempt to send the same clip, else somebody new. */
  private async personOf(newcomer: NewPerson, sha256: string): Promise<string> {
    const known = this.uploads.get(sha256);
    const isSame = ({ id, name, height_m }: ListedPerson): boolean =>
      id === known && name === newcomer.name && height_m === (newcomer.height_m ?? null);
    if (known !== null && (await this.api.people()).some(isSame)) {
      if (newcomer.consent) await this.api.giveConsent(known, newcomer.consent);
      return known;
    }
    const { id } = await this.api.createPerson(newcomer);
    this.uploads.set(sha256, id);
    return id;
  }

  /** A person without a clip would be a name that nobody bears. */
  private erasePerson(personId: string): void {
    void this.api.erasePerson(personId).catch(() => undefined);
  }

  /** The server has refused the clip or given it up, or it was never sent. */
  private leftNoClip(error: unknown, signal: AbortSignal): boolean {
    const { step, sequence, job } = this.state;
    if (step === "upload") return signal.aborted || !asProblem(error).offline;
    if (signal.aborted || asProblem(error).offline) return false;
    return sequence?.state !== "ready" && !job?.sequence_id;
  }

  private async captureAndTrain(sequence: Sequence, signal: AbortSignal): Promise<void> {
    const isCaptured = sequence.job_id === null || !["uploaded", "capturing"].includes(sequence.state);
    this.change({ step: isCaptured ? "train" : "capture", fraction: 0, message: "", sequence, job: null });
    const training = await this.trainingOf(sequence);
    signal.throwIfAborted();
    if (!isCaptured && sequence.job_id !== null) {
      const capture = await this.followCapture(await this.api.job(sequence.job_id), training.id, signal);
      if (capture.state !== "succeeded") return;
      this.change({ step: "train", fraction: 0, message: "", sequence: await this.api.sequence(sequence.id), job: null });
    }
    await this.follow(await this.api.job(training.id), signal);
  }

  /** The training of a clip, queued before its capture is done: the server goes on from one to the other by itself. */
  private async trainingOf({ id, kind }: Sequence): Promise<Job> {
    if (kind === "keypoints") throw MOTION_ONLY;
    if (this.bookmark?.sequenceId === id && this.bookmark.jobId) return this.api.job(this.bookmark.jobId);
    this.setBookmark({ name: this.state.name, sequenceId: id, jobId: null });
    const training = await this.api.train(id, this.modelOnly ? { ...TRAINING, model_only: true } : TRAINING);
    this.setBookmark({ name: this.state.name, sequenceId: id, jobId: training.id });
    return training;
  }

  /** Tell a capture's progress until it ends, and of the first likeness that the training is given meanwhile. */
  private async followCapture(capture: Job, trainingId: string, signal: AbortSignal): Promise<Job> {
    const captured = new AbortController();
    const news = ({ model_id: modelId }: Job): void => {
      if (!captured.signal.aborted && modelId !== this.state.modelId) this.change({ modelId });
    };
    // what goes wrong with it is told when the training is followed itself
    void this.api.watchJob(trainingId, news, AbortSignal.any([signal, captured.signal])).catch(() => undefined);
    try {
      return await this.follow(capture, signal);
    } finally {
      captured.abort();
    }
  }

  /** Tell a job's progress until it ends. */
  private async follow(started: Job, signal: AbortSignal): Promise<Job> {
    this.onJob(started);
    const job = await this.api.watchJob(started.id, (latest) => this.onJob(latest), signal);
    this.onJob(job);
    if (job.state === "cancelled") {
      this.change({ status: "stopped", job });
    } else if (job.state === "failed") {
      throw job.error ? Problem.from(job.error) : new Problem("The job failed", job.message, 500);
    } else if (job.kind === "train") {
      this.change({ status: "ready", fraction: 1, job, modelId: job.model_id });
    }
    return job;
  }

  private onJob(job: Job): void {
    const fraction = Math.min(1, Math.max(0, job.progress));
    // until it is trained, a first model can be met; better ones replace it
    const modelId = job.kind === "train" ? job.model_id : this.state.modelId;
    this.change({ job, fraction, message: job.message, modelId });
  }

  private async attempt(work: (signal: AbortSignal) => Promise<void>): Promise<void> {
    this.working = new AbortController();
    const { signal } = this.working;
    try {
      await work(signal);
    } catch (error) {
      if (signal.aborted) return;
      const problem = asProblem(error);
      this.change({ status: "failed", problem });
      // what can't be taken up again must not come back at the next visit
      if (!problem.offline && !this.canResume) this.setBookmark(null);
    }
  }

  private setBookmark(mark: Bookmark | null): void {
    const bookmark = mark && this.modelOnly ? { ...mark, modelOnly: true } : mark;
    this.bookmark = bookmark;
    this.onBookmark(bookmark);
  }

  private change(part: Partial<EnrolState>): void {
    this.state = { ...this.state, ...part };
    this.onChange(this.state);
  }
}
