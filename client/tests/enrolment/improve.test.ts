import { describe, expect, it } from "vitest";
import type { Api } from "../../src/api/api";
import { ModelImprovement, improvable, type ImproveState } from "../../src/enrolment/improve";
import { NO_SERVER, Problem } from "../../src/api/problem";
import type { RecordedClip } from "../../src/capture/record";
import type { Job, Performer, Sequence } from "../../src/api/types";
import type { HashedClip, UploadProgress } from "../../src/api/upload";
import { hashClip, job, sequence } from "../fakes";

const FILM: RecordedClip = { blob: new Blob(["film"]), fileName: "webcam.mp4" };
const CONFLICT = new Problem("Conflict", "", 409);
const GONE = new Problem("Not found", "", 404);

/** A server that keeps one film, and works only as far as it is not held. */
class FakeServer {
  calls: string[] = [];
  hold: "upload" | "c" | "j" | null = null;
  phase: UploadProgress["phase"] = "sending";
  /** Whose answer is waited for whatever happens. */
  isLastPiece = false;
  film: Sequence | null = null;
  quality: Sequence["quality"] = { advice: ["Nothing needs to be filmed again."] };
  jobs: Record<string, Job> = {};
  away = false;
  private held: ((job: Job) => void) | null = null;
  private answer: (() => void) | null = null;

  hashClip = hashClip;
  async uploadSequence(
    person: string, { fileName }: HashedClip, onProgress: (progress: UploadProgress) => void, signal: AbortSignal,
  ): Promise<Sequence> {
    this.calls.push(`upload ${person} ${fileName}`);
    onProgress({ phase: this.phase, fraction: 0.5 });
    if (this.hold === "upload") {
      await new Promise<void>((resolve, reject) => {
        this.answer = resolve;
        if (!this.isLastPiece) signal.addEventListener("abort", () => reject(signal.reason));
      });
    }
    this.jobs["c"] = job({ id: "c", kind: "capture", state: "queued" });
    return (this.film = sequence({ state: "uploaded", job_id: "c" }));
  }
  arrive(): void {
    this.answer?.();
  }
  async sequence(): Promise<Sequence> {
    if (this.away) throw NO_SERVER;
    if (!this.film) throw GONE;
    return this.film;
  }
  async deleteSequence(id: string): Promise<void> {
    if (!this.film) {
      this.calls.push(`delete ${id}, which is gone`);
      throw GONE;
    }
    if (Object.values(this.jobs).some(({ state }) => ["queued", "running"].includes(state))) throw CONFLICT;
    this.calls.push(`delete ${id}`);
    this.film = null;
  }
  async train(id: string, options: object): Promise<Job> {
    this.calls.push(`train ${id} ${JSON.stringify(options)}`);
    return (this.jobs["j"] = job({ state: "queued" }));
  }
  async job(id: string): Promise<Job> {
    return this.jobs[id] as Job;
  }
  async cancelJob(id: string): Promise<void> {
    this.calls.push(`cancel ${id}`);
    if (id === "c") this.film = null; // as the server does with what was never captured
    this.end(id, "cancelled");
  }
  async watchJob(id: string, onJob: (job: Job) => void, signal: AbortSignal): Promise<Job> {
    const now = this.jobs[id] as Job;
    if (now.state === "cancelled") return now;
    onJob((this.jobs[id] = { ...now, state: "running", progress: 0.5, message: "half", model_id: id === "j" ? "early" : null }));
    if (this.hold === id) {
      return new Promise((resolve, reject) => {
        this.held = resolve;
        signal.addEventListener("abort", () => reject(signal.reason));
      });
    }
    return this.end(id, "succeeded");
  }
  end(id: string, state: Job["state"], error: Job["error"] = null): Job {
    const ended = (this.jobs[id] = { ...(this.jobs[id] as Job), state, error });
    if (state === "succeeded" && this.film) {
      this.film = { ...this.film, state: id === "c" ? "ready" : "forgotten", quality: this.quality };
    }
    this.held?.(ended);
    return ended;
  }
}

function setUp(server = new FakeServer()) {
  const states: ImproveState[] = [];
  let left: string[] = [];
  const notes = { get: () => left, set: (ids: string[]) => void (left = ids) };
  const improvement = new ModelImprovement(server as unknown as Api, notes, (state) => states.push(state));
  const start = (currentModelId: string | null = "m"): Promise<void> =>
    improvement.start("p", () => currentModelId, async (onSecond) => (onSecond(10), FILM));
  const soon = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));
  return { server, states, improvement, start, soon, left: () => left, notes };
}

describe("ModelImprovement", () => {
  it("leads from a film to a better model in the place of the one that stands", async () => {
    const { server, states, start, left } = setUp();
    await start();
    const training = { preset: "splats", seed: 0, model_only: true, improves: "m" };
    expect(server.calls).toEqual(["upload p webcam.mp4", `train s ${JSON.stringify(training)}`]);
    const kinds = states.map((state) => (state.kind === "working" ? state.step : state.kind));
    expect(kinds.filter((kind, i) => kind !== kinds[i - 1])).toEqual(["filming", "upload", "capture", "train", "better"]);
    expect(states.at(-1)).toEqual({ kind: "better", advice: [] });
    expect(server.film?.state).toBe("forgotten");
    expect(left()).toEqual([]);
  });

  it("passes on what the capture advises", async () => {
    const { server, states, start } = setUp();
    server.quality = { advice: ["Turn more slowly."] };
    await start();
    expect(states.at(-1)).toEqual({ kind: "better", advice: ["Turn more slowly."] });
  });

  it("sends nothing when it is taken back while filming", async () => {
    const { server, states, improvement } = setUp();
    const running = improvement.start("p", () => "m", (onSecond, signal) => {
      onSecond(4);
      return new Promise((_, reject) => signal.addEventListener("abort", () => reject(signal.reason)));
    });
    await improvement.cancel();
    await running;
    expect(server.calls).toEqual([]);
    expect(states.at(-1)).toEqual({ kind: "stopped", improved: false, clipOnServer: false });
  });

  it("breaks an upload off", async () => {
    const { server, states, improvement, start, soon } = setUp();
    server.hold = "upload";
    const running = start();
    await soon();
    await improvement.cancel();
    await running;
    expect(server.film).toBeNull();
    expect(states.at(-1)?.kind).toBe("stopped");
  });

  it("says that it tries again while the server is out of reach", async () => {
    const { server, states, improvement, start, soon } = setUp();
    Object.assign(server, { hold: "upload", phase: "waiting" });
    const running = start();
    await soon();
    expect(states.at(-1)).toMatchObject({ kind: "working", step: "upload", fraction: 0.5, message: "Interrupted, trying again" });
    await improvement.cancel();
    await running;
  });

  it("waits for a film that was sent whole, to remove it by its name", async () => {
    const { server, states, improvement, start, soon } = setUp();
    Object.assign(server, { hold: "upload", isLastPiece: true });
    const running = start();
    await soon();
    const back = improvement.cancel();
    expect(states.at(-1)?.kind).toBe("stopping");
    server.arrive();
    await Promise.all([back, running]);
    expect(server.calls.slice(1)).toEqual(["cancel c"]);
    expect([server.film, states.at(-1)?.kind]).toEqual([null, "stopped"]);
  });

  it("cancels a capture, and its film is gone", async () => {
    const { server, improvement, start, soon, left } = setUp();
    server.hold = "c";
    const running = start();
    await soon();
    expect(left()).toEqual(["s"]);
    await improvement.cancel();
    await running;
    expect(server.calls.slice(1)).toEqual(["cancel c"]);
    expect([server.film, left()]).toEqual([null, []]);
  });

  it("cancels a training, removes its film, and says that a first version stands", async () => {
    const { server, states, improvement, start, soon, left } = setUp();
    server.hold = "j";
    const running = start();
    await soon();
    await improvement.cancel();
    await running;
    expect(server.calls.slice(2)).toEqual(["cancel j", "delete s"]);
    expect(states.at(-1)).toEqual({ kind: "stopped", improved: true, clipOnServer: false });
    expect(left()).toEqual([]);
  });

  it("tells why it failed, and removes the film", async () => {
    const { server, states, start, soon, left } = setUp();
    server.hold = "j";
    server.quality = { advice: ["Add light."] };
    const running = start();
    await soon();
    server.end("j", "failed", { type: "", title: "Worker died", detail: "again", status: 500 });
    await running;
    expect(states.at(-1)).toMatchObject({ kind: "failed", problem: { title: "Worker died" }, advice: ["Add light."], clipOnServer: false });
    expect([server.film, left()]).toEqual([null, []]);
  });

  it("begins no training for somebody who has left the meeting", async () => {
    const { server, states, start } = setUp();
    await start(null);
    expect(states.at(-1)).toMatchObject({ kind: "failed", problem: { title: "Your model is no longer in this meeting" } });
    expect(server.calls.slice(1)).toEqual(["delete s"]);
  });

  it("removes at the next visit what it could not reach", async () => {
    const { server, states, improvement, start, soon, left, notes } = setUp();
    server.hold = "c";
    const running = start();
    await soon();
    server.away = true;
    await improvement.cancel();
    await running;
    expect(states.at(-1)).toMatchObject({ kind: "stopped", clipOnServer: true });
    expect(left()).toEqual(["s"]);
    server.away = false;
    await new ModelImprovement(server as unknown as Api, notes, () => undefined).deletePending();
    expect([server.film, left()]).toEqual([null, []]);
  });

  it("lets the server finish what it learns when one leaves, and nothing else", async () => {
    const learning = setUp();
    learning.server.hold = "j";
    const running = learning.start();
    await learning.soon();
    await learning.improvement.leave();
    await running;
    expect(learning.server.calls).toHaveLength(2);
    // while it learns, the film is in use; afterwards it is forgotten
    await learning.improvement.deletePending();
    expect(learning.left()).toEqual(["s"]);
    learning.server.end("j", "succeeded");
    await learning.improvement.deletePending();
    expect(learning.left()).toEqual([]);

    const capturing = setUp();
    capturing.server.hold = "c";
    const stopped = capturing.start();
    await capturing.soon();
    await capturing.improvement.leave();
    await stopped;
    expect(capturing.server.film).toBeNull();
  });
});

describe("improvable", () => {
  const performer = (id: string): Performer => ({ id: `of-${id}`, name: id, model_id: id }) as Performer;
  const api = (people: object[], models: object[]): Api =>
    ({ people: async () => people, models: async () => models }) as unknown as Api;

  it("is who is ours, is drawn by splats, and stands here", async () => {
    const people = [{ id: "p", mine: true }, { id: "lent", mine: false }];
    const models = [
      { id: "mine", person_id: "p", preset: "splats" },
      { id: "field", person_id: "p", preset: "fast" },
      { id: "theirs", person_id: "lent", preset: "splats" },
      { id: "elsewhere", person_id: "p", preset: "splats" },
    ];
    const here = ["mine", "field", "theirs", "stranger"].map(performer);
    expect(await improvable(api(people, models), here)).toEqual([{ performerId: "of-mine", personId: "p", modelId: "mine", name: "mine" }]);
  });

  it("is nobody for who was only invited to look", async () => {
    const refused = { people: () => Promise.reject(new Problem("No", "", 403)), models: async () => [] } as unknown as Api;
    expect(await improvable(refused, [performer("m")])).toEqual([]);
  });
});
