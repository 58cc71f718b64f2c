/** The server's REST calls, typed. Every failure is thrown as a Problem. */

import { NO_GUESTS, NO_SERVER, Problem, SIGNED_OUT, problemOf } from "./problem";
import { loadSplats } from "./splats";
import { readEvents } from "./sse";
import type { TokenStore } from "./tokenStore";
import { hashClip, sendClip, type HashedClip, type UploadProgress, type UploadRoutes } from "./upload";
import { sleep } from "./until";
import type {
  Consent,
  DemoMeeting,
  Environment,
  Environments,
  ExistingSequence,
  Guest,
  Invitation,
  Job,
  ListedPerson,
  Meeting,
  MeetingHome,
  Model,
  Models,
  NewConsent,
  NewMeeting,
  NewModel,
  NewPerformer,
  NewPerson,
  NewUpload,
  NewVideo,
  NewView,
  OpenedMeeting,
  People,
  Performer,
  Person,
  Place,
  Recording,
  RecordingInFull,
  Recordings,
  Seat,
  Sequence,
  Upload,
  Visitor,
} from "./types";

const FINAL: ReadonlySet<Job["state"]> = new Set(["succeeded", "failed", "cancelled"]);

export function isFinal(job: Job): boolean {
  return FINAL.has(job.state);
}

export class Api implements UploadRoutes {
  private pendingToken: Promise<string> | null = null;
  /** A token that has run out still says who we are. */
  private expiredToken: string | null = null;

  constructor(
    private readonly tokens: TokenStore,
    private readonly request: typeof fetch = (input, init) => fetch(input, init),
    private readonly hash: (clip: Blob, signal: AbortSignal) => Promise<string> = hashClip,
  ) {}

  /** The meeting that the demo shows, if this server runs one. */
  async demoMeeting(): Promise<string | null> {
    return (await this.json<DemoMeeting>("GET", "/v1/demo")).meeting_id;
  }

  createPerson(person: NewPerson): Promise<Person> {
    return this.json("POST", "/v1/people", person);
  }

  /** What a model may be used for from now on, revoked before or not. */
  giveConsent(personId: string, consent: NewConsent): Promise<Consent> {
    return this.json("PUT", `/v1/people/${personId}/consent`, consent);
  }

  revokeConsent(personId: string): Promise<Consent> {
    return this.json("DELETE", `/v1/people/${personId}/consent`);
  }

  /** Every row and object of theirs. */
  async erasePerson(id: string): Promise<void> {
    await this.send("DELETE", `/v1/people/${id}`);
  }

  /** Everybody of this account, the oldest first; before them whom the demo lends. */
  async people(): Promise<ListedPerson[]> {
    return (await this.json<People>("GET", "/v1/people")).items;
  }

  /** Their models, the oldest first. */
  async models(): Promise<Model[]> {
    return (await this.json<Models>("GET", "/v1/models")).items;
  }

  model(id: string): Promise<Model> {
    return this.json("GET", `/v1/models/${id}`);
  }

  sequence(id: string): Promise<Sequence> {
    return this.json("GET", `/v1/sequences/${id}`);
  }

  /** A clip with its frames and motion; models of it stay. */
  async deleteSequence(id: string): Promise<void> {
    await this.send("DELETE", `/v1/sequences/${id}`);
  }

  train(sequenceId: string, training: NewModel): Promise<Job> {
    return this.json("POST", `/v1/sequences/${sequenceId}/models`, training);
  }

  job(id: string): Promise<Job> {
    return this.json("GET", `/v1/jobs/${id}`);
  }

  async cancelJob(id: string): Promise<void> {
    await this.send("DELETE", `/v1/jobs/${id}`);
  }

  async resumeJob(id: string): Promise<Job> {
    await this.send("POST", `/v1/jobs/${id}/resume`);
    return this.job(id);
  }

  async preview(jobId: string): Promise<Blob> {
    return (await this.send("GET", `/v1/jobs/${jobId}/preview`)).blob();
  }

  /** Recorded meetings that we asked for, or agreed to. */
  async recordings(): Promise<Recording[]> {
    return (await this.json<Recordings>("GET", "/v1/recordings")).items;
  }

  recording(id: string): Promise<RecordingInFull> {
    return this.json("GET", `/v1/recordings/${id}`);
  }

  /** The panorama that the host of a recorded meeting had uploaded. */
  recordedEnvironment(id: string): Promise<Environment> {
    return this.json("GET", `/v1/recordings/${id}/place`);
  }

  async deleteRecording(id: string): Promise<void> {
    await this.send("DELETE", `/v1/recordings/${id}`);
  }

  /** Take what we moved, said and wrote out of a recording. */
  async leaveRecording(id: string): Promise<void> {
    await this.send("DELETE", `/v1/recordings/${id}/mine`);
  }

  exportRecording(id: string, video: NewVideo): Promise<Job> {
    return this.json("POST", `/v1/recordings/${id}/export`, video);
  }

  /** Some file of the server's that takes a token. */
  async file(path: string): Promise<Blob> {
    return (await this.send("GET", path)).blob();
  }

  /** A meeting, as whoever holds `token` sees it: with their seat's, whatever became of the invitation. */
  async meeting(id: string, token = ""): Promise<Meeting> {
    const path = `/v1/meetings/${id}`;
    if (token === "") return this.json<Meeting>("GET", path);
    return (await checked(await this.attempt("GET", path, token, undefined))).json() as Promise<Meeting>;
  }

  /** A new link into a meeting, in place of those of before; `token` is the host's seat. Says the link. */
  async renewInvitation(meetingId: string, token: string): Promise<string> {
    const response = await checked(await this.attempt("POST", `/v1/meetings/${meetingId}/invitation`, token, undefined));
    return ((await response.json()) as Invitation).join_url;
  }

  /** Every environment that the server ships. */
  async environments(): Promise<Environment[]> {
    return (await this.json<Environments>("GET", "/v1/environments")).items;
  }

  /** Where a meeting is held. */
  environment(meetingId: string): Promise<Environment> {
    return this.json("GET", `/v1/meetings/${meetingId}/environment`);
  }

  /** Hold a meeting somewhere else; `token` is the host's seat. */
  async setEnvironment(meetingId: string, name: string, token: string): Promise<Environment> {
    const path = `/v1/meetings/${meetingId}/environment`;
    return (await checked(await this.attempt("PUT", path, token, { name } satisfies Place))).json() as Promise<Environment>;
  }

  /** Hold a meeting in a panorama of the host's own. */
  async uploadPanorama(meetingId: string, picture: Blob, token: string): Promise<Environment> {
    const init = { method: "PUT", headers: { Authorization: `Bearer ${token}` }, body: picture };
    const sent = this.request(`/v1/meetings/${meetingId}/panorama`, init);
    return (await checked(await reached(sent))).json() as Promise<Environment>;
  }

  /** The file from which a model of ours is drawn; null where it has none. */
  async splats(modelId: string): Promise<ArrayBuffer | null> {
    return loadSplats(modelId, await this.token(), this.request);
  }

  /** A small picture of a model, from the front. */
  async modelPicture(modelId: string): Promise<Blob> {
    const camera = { orbit: { distance_m: 3 } };
    const body = { camera, width: 96, height: 128, format: "webp" } satisfies NewView;
    return (await this.send("POST", `/v1/models/${modelId}/views`, body)).blob();
  }

  async createMeeting(name: string, modelIds: string[], sealed = false): Promise<Meeting> {
    const body = { name, model_ids: modelIds, sealed } satisfies NewMeeting;
    const { host_token, ...meeting } = await this.json<OpenedMeeting>("POST", "/v1/meetings", body);
    this.tokens.setHost(meeting.id, host_token);
    return meeting;
  }

  /** Stand a model in a meeting; it moves by a sequence's motion, or as it was filmed. */
  addPerformer(
    meetingId: string,
    modelId: string,
    motionSequenceId: string | null = null,
  ): Promise<Performer> {
    const body = { model_id: modelId, motion_sequence_id: motionSequenceId } satisfies NewPerformer;
    return this.json("POST", `/v1/meetings/${meetingId}/performers`, body);
  }

  /** A seat; as its host in a meeting that we opened. */
  async join(meetingId: string, displayName: string): Promise<Seat> {
    const path = `/v1/meetings/${meetingId}/join`;
    const body = { display_name: displayName } satisfies Visitor;
    const host = this.tokens.getHost(meetingId);
    if (host === null) return this.json("POST", path, body);
    const response = await this.attempt("POST", path, host, body);
    // a host's token that has run out is no worse than none
    if (response.status === 401) return this.json("POST", path, body);
    return (await checked(response)).json() as Promise<Seat>;
  }

  /** The gateway that a meeting lives on, by its address; empty: whichever is asked. */
  async home(meetingId: string, token: string): Promise<string> {
    const asked = await checked(await this.attempt("GET", `/v1/meetings/${meetingId}/home`, token, undefined));
    return ((await asked.json()) as MeetingHome).gateway_url;
  }

  /** What a clip is known by to `uploadSequence`. Throws a Problem where it cannot be read. */
  async hashClip(blob: Blob, fileName: string, signal: AbortSignal): Promise<HashedClip> {
    return { blob, fileName, sha256: await this.hash(blob, signal) };
  }

  /** Upload a clip, or what is missing of it; see `sendClip`. */
  uploadSequence(
    personId: string,
    clip: HashedClip,
    onProgress: (progress: UploadProgress) => void,
    signal: AbortSignal,
  ): Promise<Sequence> {
    return sendClip(this, personId, clip, onProgress, signal);
  }

  beginUpload(personId: string, clip: NewUpload, signal: AbortSignal): Promise<Upload | ExistingSequence> {
    return this.json("POST", `/v1/people/${personId}/uploads`, clip, { signal, timeoutMs: SILENCE_MS });
  }

  async sendPiece({ id, offset }: Upload, piece: ArrayBuffer, signal?: AbortSignal): Promise<number | Sequence> {
    const headers = { "Upload-Offset": String(offset) };
    const answer = await this.send("PATCH", `/v1/uploads/${id}`, piece, { signal, headers, timeoutMs: SILENCE_MS });
    return answer.status === 202 ? ((await answer.json()) as Sequence) : Number(answer.headers.get("Upload-Offset"));
  }

  async deleteUpload(id: string): Promise<void> {
    await this.send("DELETE", `/v1/uploads/${id}`);
  }

  /**
   * Follow a job to its end through server-sent events; a broken stream is opened again.
   * Returns the job in its final state. Aborting `signal` throws its reason.
   */
  async watchJob(id: string, onJob: (job: Job) => void, signal: AbortSignal): Promise<Job> {
    for (let attempt = 0; ; attempt++) {
      try {
        const response = await this.send("GET", `/v1/jobs/${id}/events`, undefined, { signal });
        if (response.body) {
          for await (const { event, data } of readEvents(response.body)) {
            if (event === "end") break;
            if (event !== "progress") continue;
            attempt = 0;
            onJob(JSON.parse(data) as Job);
          }
        }
        const job = await this.job(id);
        onJob(job);
        if (isFinal(job)) return job;
      } catch (error) {
        signal.throwIfAborted();
        const passing = !(error instanceof Problem) || error.offline || error.status === 503;
        if (!passing || attempt >= MAX_ATTEMPTS) throw error;
      }
      await sleep(Math.min(250 * 2 ** attempt, 4000), signal);
    }
  }

  /** A call with a JSON answer. */
  private async json<T>(method: string, path: string, body?: unknown, options?: Options): Promise<T> {
    return (await this.send(method, path, body, options)).json() as Promise<T>;
  }

  private async send(method: string, path: string, body?: unknown, options?: Options): Promise<Response> {
    const token = await this.token();
    let response = await this.attempt(method, path, token, body, options);
    if (response.status === 401 && this.tokens.get() !== null) {
      // the token has run out, or belongs to a server that has been set up anew
      this.expiredToken = this.tokens.get();
      this.tokens.set(null);
      response = await this.attempt(method, path, await this.token(), body, options);
    }
    return checked(response);
  }

  /** `body` goes as it is if it is bytes, else as JSON. */
  private async attempt(
    method: string,
    path: string,
    token: string,
    body: unknown,
    { signal, headers: more, timeoutMs }: Options = {},
  ): Promise<Response> {
    const headers: Record<string, string> = { Authorization: `Bearer ${token}`, ...more };
    const init: RequestInit = { method, headers };
    const timeout = timeoutMs === undefined ? null : AbortSignal.timeout(timeoutMs);
    const end = signal && timeout ? AbortSignal.any([signal, timeout]) : (signal ?? timeout);
    if (end) init.signal = end;
    if (body instanceof ArrayBuffer) {
      headers["Content-Type"] = "application/octet-stream";
      init.body = body;
    } else if (body !== undefined) {
      headers["Content-Type"] = "application/json";
      init.body = JSON.stringify(body);
    }
    return reached(this.request(path, init), signal);
  }

  /** The stored token, else a guest's; calls that come meanwhile share one request. */
  private async token(): Promise<string> {
    const known = this.tokens.get();
    if (known !== null) return known;
    // who was signed in is not made a guest unasked
    if (this.tokens.account() !== null) throw SIGNED_OUT;
    this.pendingToken ??= this.requestGuestToken().finally(() => {
      this.pendingToken = null;
    });
    return this.pendingToken;
  }

  private async requestGuestToken(): Promise<string> {
    const response = await reached(this.request("/v1/guest", { method: "POST", headers: this.expiredToken ? { Authorization: `Bearer ${this.expiredToken}` } : {} }));
    if (response.status === 401 || response.status === 403) throw NO_GUESTS;
    if (!response.ok) {
      throw problemOf(response.status, await response.text(), response.headers.get("Retry-After"));
    }
    const { token } = (await response.json()) as Guest;
    this.tokens.set(token);
    return token;
  }
}

const MAX_ATTEMPTS = 8;
/** A line on which nothing comes of an upload for so long is lost. */
const SILENCE_MS = 60_000;

interface Options {
  signal?: AbortSignal | undefined;
  headers?: Record<string, string>;
  /** How long the answer may take. */
  timeoutMs?: number;
}

/** The response, or the problem that it tells. */
async function checked(response: Response): Promise<Response> {
  if (response.ok) return response;
  throw problemOf(response.status, await response.text(), response.headers.get("Retry-After"));
}

/** The response, or NO_SERVER where none came. */
async function reached(response: Promise<Response>, signal?: AbortSignal): Promise<Response> {
  try {
    return await response;
  } catch {
    signal?.throwIfAborted();
    throw NO_SERVER;
  }
}
