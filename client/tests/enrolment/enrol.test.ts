import { describe, expect, it } from "vitest";
import type { Api } from "../../src/api/api";
import { Enrolment, type Bookmark, type EnrolState } from "../../src/enrolment/enrol";
import { NO_SERVER, Problem } from "../../src/api/problem";
import type { Job, ListedPerson, NewConsent, NewPerson, Sequence } from "../../src/api/types";
import type { HashedClip, UploadProgress } from "../../src/api/upload";
import { hashClip, job, sequence } from "../fakes";

const ADA = { name: "Ada", height_m: 1.78 };
const CLIP = { blob: new Blob(["clip"]), fileName: "me.mp4" };
const CAPTURE = job({ id: "c", kind: "capture" });

/** A server that captures and trains at once, unless told otherwise. */
class FakeServer {
  calls: string[] = [];
  uploaded: Sequence = sequence({ state: "capturing", job_id: "c" });
  captured: Sequence = sequence({ quality: { advice: ["Turn more slowly."] } });
  outcome: Record<string, Job> = {
    c: { ...CAPTURE, state: "succeeded", progress: 1 },
    j: job({ state: "succeeded", progress: 1, model_id: "m" }),
  };
  known: Partial<ListedPerson>[] = [];
  refusal: Problem | null = null;
  held: { id: string; end: (job: Job) => void } | null = null;
  hold: string | null = null;

  async createPerson({ name, height_m }: NewPerson): Promise<object> {
    this.calls.push(`person ${name} ${height_m}`);
    return { id: "p", name };
  }
  async erasePerson(id: string): Promise<void> {
    this.calls.push(`erase ${id}`);
  }
  async giveConsent(id: string, { purposes }: NewConsent): Promise<void> {
    this.calls.push(`consent ${id} ${purposes.join()}`);
  }
  async people(): Promise<Partial<ListedPerson>[]> {
    return this.known;
  }
  hashClip = hashClip;
  async uploadSequence(
    person: string, { fileName }: HashedClip, onProgress: (progress: UploadProgress) => void, signal: AbortSignal,
  ): Promise<Sequence> {
    this.calls.push(`upload ${fileName} of ${person}`);
    onProgress({ phase: "sending", fraction: 0.5 });
    if (this.refusal) throw this.refusal;
    if (this.hold === "upload") {
      await new Promise((_, reject) => signal.addEventListener("abort", () => reject(signal.reason)));
    }
    return this.uploaded;
  }
  async sequence(): Promise<Sequence> {
    return this.captured;
  }
  async job(id: string): Promise<Job> {
    return id === "c" ? CAPTURE : job({ model_id: (this.outcome[id] as Job).model_id });
  }
  async train(id: string, options: object): Promise<Job> {
    this.calls.push(`train ${id} ${JSON.stringify(options)}`);
    return job({ state: "queued" });
  }
  async cancelJob(id: string): Promise<void> {
    this.calls.push(`cancel ${id}`);
    this.held?.end(job({ id, state: "cancelled", progress: 0.5 }));
  }
  async resumeJob(id: string): Promise<Job> {
    this.calls.push(`resume ${id}`);
    this.hold = null;
    return job({ id, state: "queued", progress: 0.5 });
  }
  async watchJob(id: string, onJob: (job: Job) => void): Promise<Job> {
    const last = this.outcome[id] as Job;
    onJob({ ...last, state: "running", progress: 0.5, message: "half" });
    if (this.hold !== id) return last;
    return new Promise((end) => (this.held = { id, end }));
  }
}

function setUp(server = new FakeServer()) {
  const underWay = new Map<string, string>();
  const states: EnrolState[] = [];
  const bookmarks: (Bookmark | null)[] = [];
  const enrolment = new Enrolment(
    server as unknown as Api,
    (state) => states.push(state),
    (bookmark) => bookmarks.push(bookmark),
    { get: (sha256) => underWay.get(sha256) ?? null, set: (sha256, id) => void (id === null ? underWay.delete(sha256) : underWay.set(sha256, id)) },
  );
  const soon = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));
  return { server, states, bookmarks, underWay, enrolment, soon };
}

describe("Enrolment", () => {
  it("leads from a clip to a model", async () => {
    const { server, states, bookmarks, enrolment } = setUp();
    await enrolment.start(ADA, CLIP);
    expect(server.calls).toEqual([
      "person Ada 1.78",
      "upload me.mp4 of p",
      'train s {"preset":"splats","seed":0}',
    ]);
    expect(enrolment.state).toMatchObject({ status: "ready", modelId: "m", name: "Ada" });
    expect(enrolment.state.sequence?.quality?.advice).toEqual(["Turn more slowly."]);
    const steps = states.map(({ step }) => step).filter((step, i, all) => step !== all[i - 1]);
    expect(steps).toEqual(["upload", "capture", "train"]);
    expect(states.some(({ step, fraction }) => step === "upload" && fraction === 0.5)).toBe(true);
    expect(bookmarks).toEqual([
      { name: "Ada", sequenceId: "s", jobId: null },
      { name: "Ada", sequenceId: "s", jobId: "j" },
    ]);
  });

  it("can be met as soon as there is a first model", async () => {
    const { server, states, enrolment } = setUp();
    server.uploaded = server.captured;
    server.outcome["j"] = job({ model_id: "early" });
    await enrolment.start(ADA, CLIP);
    const first = states.find(({ modelId }) => modelId !== null);
    expect(first).toMatchObject({ status: "working", step: "train", modelId: "early" });
  });

  it("can be met by a first likeness while the clip is still being captured", async () => {
    const { server, states, enrolment, soon } = setUp();
    server.hold = "c";
    server.outcome["j"] = job({ state: "queued", model_id: "likeness" });
    const running = enrolment.start(ADA, CLIP);
    await soon();
    expect(enrolment.state).toMatchObject({ status: "working", step: "capture", modelId: "likeness" });
    server.outcome["j"] = job({ state: "succeeded", progress: 1, model_id: "m" });
    server.held?.end({ ...CAPTURE, state: "succeeded", progress: 1 });
    await running;
    expect(enrolment.state).toMatchObject({ status: "ready", step: "train", modelId: "m" });
    const met = states.slice(states.findIndex(({ modelId }) => modelId !== null));
    expect(met.every(({ modelId }) => modelId !== null)).toBe(true);
  });

  it("goes on after the page was reloaded", async () => {
    const { server, enrolment } = setUp();
    await enrolment.continueFrom({ name: "Ada", sequenceId: "s", jobId: null });
    expect(server.calls).toHaveLength(1);
    expect(enrolment.state.status).toBe("ready");
  });

  it("finds a training again that is under way, and begins no second one", async () => {
    const { server, enrolment } = setUp();
    await enrolment.continueFrom({ name: "Ada", sequenceId: "s", jobId: "j" });
    expect(server.calls).toEqual([]);
    expect(enrolment.state).toMatchObject({ status: "ready", step: "train", modelId: "m" });
  });

  it("finds a capture again that is under way, and queues no second training behind it", async () => {
    const { server, states, enrolment } = setUp();
    server.captured = server.uploaded;
    await enrolment.continueFrom({ name: "Ada", sequenceId: "s", jobId: "j" });
    expect(server.calls).toEqual([]);
    const steps = states.map(({ step }) => step).filter((step, i, all) => step !== all[i - 1]);
    expect(steps).toEqual(["capture", "train"]);
    expect(enrolment.state).toMatchObject({ status: "ready", modelId: "m" });
  });

  it("stops an upload", async () => {
    const { server, enrolment } = setUp();
    server.hold = "upload";
    const running = enrolment.start(ADA, CLIP);
    await new Promise((resolve) => setTimeout(resolve));
    await enrolment.cancel();
    await running;
    expect(enrolment.state).toMatchObject({ status: "stopped", problem: null });
    expect(enrolment.canResume).toBe(false);
    expect(server.calls.at(-1)).toBe("erase p");
  });

  it("stops a training and takes it up again", async () => {
    const { server, enrolment, soon } = setUp();
    server.hold = "j";
    const running = enrolment.start(ADA, CLIP);
    await soon();
    await enrolment.cancel();
    await running;
    expect(enrolment.state.status).toBe("stopped");
    expect(enrolment.canResume).toBe(true);
    await enrolment.resume();
    expect(server.calls.slice(-2)).toEqual(["cancel j", "resume j"]);
    expect(enrolment.state).toMatchObject({ status: "ready", modelId: "m" });
  });

  it("stops a capture, which can't be taken up again", async () => {
    const { server, enrolment, soon } = setUp();
    server.hold = "c";
    const running = enrolment.start(ADA, CLIP);
    await soon();
    await enrolment.cancel();
    await running;
    expect(server.calls).toContain("cancel c");
    expect(enrolment.state.status).toBe("stopped");
  });

  it("tells why a capture failed, in the server's words", async () => {
    const { server, enrolment, bookmarks } = setUp();
    const error = {
      type: "urn:metanerf:no-person",
      title: "Nobody found",
      detail: "a clip must show a person",
      status: 422,
    };
    server.outcome["c"] = { ...CAPTURE, state: "failed", error, sequence_id: null };
    await enrolment.start(ADA, CLIP);
    expect(enrolment.state.status).toBe("failed");
    expect(enrolment.state.problem).toMatchObject({
      title: "Nobody found",
      detail: "A clip must show a person.",
    });
    expect(enrolment.canResume).toBe(false);
    expect(bookmarks.at(-1)).toBeNull();
    expect(server.calls.at(-1)).toBe("erase p");
  });

  it("goes on with a clip that the server kept although its capture failed", async () => {
    const { server, enrolment, bookmarks } = setUp();
    const error = { type: "urn:metanerf:no-space-left", title: "No space left", detail: "", status: 507 };
    const captured = server.outcome["c"] as Job;
    server.outcome["c"] = { ...CAPTURE, state: "failed", error };
    await enrolment.start(ADA, CLIP);
    expect(enrolment.canResume).toBe(true);
    expect(bookmarks.at(-1)).toMatchObject({ sequenceId: "s", jobId: "j" });
    server.outcome["c"] = captured;
    await enrolment.resume();
    expect(server.calls.slice(-2)).toEqual([expect.stringMatching("train s"), "resume c"]);
    expect(enrolment.state).toMatchObject({ status: "ready", modelId: "m" });
    expect(server.calls).not.toContain("erase p");
  });

  it("lets a failed training be tried again from where it was", async () => {
    const { server, enrolment, bookmarks } = setUp();
    const error = { type: "urn:metanerf:worker-died", title: "Worker died", detail: "", status: 500 };
    server.outcome["j"] = job({ state: "failed", error });
    await enrolment.start(ADA, CLIP);
    expect(enrolment.state.problem).toBeInstanceOf(Problem);
    expect(enrolment.canResume).toBe(true);
    expect(bookmarks.at(-1)).toMatchObject({ jobId: "j" });
    expect(server.calls).not.toContain("erase p");
  });

  it("refuses movement alone as a person", async () => {
    const { server, enrolment } = setUp();
    server.uploaded = sequence({ kind: "keypoints", job_id: null });
    await enrolment.start(ADA, { blob: new Blob(["{}"]), fileName: "walk.json" });
    expect(enrolment.state.problem?.title).toBe("This file contains motion only");
    expect(server.calls.some((call) => call.startsWith("train"))).toBe(false);
  });

  it("keeps its place when the server is gone", async () => {
    const { server, enrolment, bookmarks } = setUp();
    const watchJob = server.watchJob.bind(server);
    server.watchJob = () => Promise.reject(NO_SERVER);
    await enrolment.start(ADA, CLIP);
    expect(enrolment.state).toMatchObject({ status: "failed", problem: NO_SERVER });
    expect(bookmarks.at(-1)).toMatchObject({ name: "Ada", sequenceId: "s" });
    expect(enrolment.canReconnect).toBe(true);
    server.watchJob = watchJob;
    await enrolment.reconnect();
    expect(enrolment.state).toMatchObject({ status: "ready", problem: null });
    expect(server.calls.filter((call) => call.startsWith("upload"))).toHaveLength(1);
    expect(server.calls).not.toContain("erase p");
  });

  it("sends the clip on, without being given it again, when the server is back", async () => {
    const { server, states, underWay, enrolment } = setUp();
    server.refusal = NO_SERVER;
    await enrolment.start(ADA, CLIP);
    expect(enrolment.state).toMatchObject({ status: "failed", problem: NO_SERVER });
    expect([enrolment.canReconnect, [...underWay.values()]]).toEqual([true, ["p"]]);
    Object.assign(server, { refusal: null, known: [{ id: "p", ...ADA }] });
    states.length = 0;
    await enrolment.reconnect();
    expect(states[0]).toMatchObject({ status: "working", step: "upload", problem: null, message: "Preparing your clip" });
    expect(enrolment.state.status).toBe("ready");
    expect(server.calls.slice(0, 3)).toEqual(["person Ada 1.78", "upload me.mp4 of p", "upload me.mp4 of p"]);
    expect(underWay.size).toBe(0);
  });

  it.each([
    ["is gone on with for the same person after a reload", [{ id: "old", ...ADA }], "old"],
    ["is begun anew for somebody of another name", [{ id: "old", ...ADA, name: "Bo" }], "p"],
    ["is begun anew for somebody of another height", [{ id: "old", ...ADA, height_m: null }], "p"],
    ["is begun anew where the person is gone", [], "p"],
  ])("A clip that was cut off %s", async (_, known, person) => {
    const { server, underWay, enrolment } = setUp();
    server.known = known;
    underWay.set((await hashClip(CLIP.blob, "")).sha256, "old");
    await enrolment.start(ADA, CLIP);
    expect(server.calls.filter((call) => call.startsWith("upload"))).toEqual([`upload me.mp4 of ${person}`]);
    expect(server.calls.some((call) => call.startsWith("person"))).toBe(person === "p");
    expect(underWay.size).toBe(0);
  });

  it("takes the consent of now for whom a clip was begun before", async () => {
    const { server, underWay, enrolment } = setUp();
    server.known = [{ id: "old", ...ADA }];
    underWay.set((await hashClip(CLIP.blob, "")).sha256, "old");
    await enrolment.start({ ...ADA, consent: { purposes: ["meetings"] } }, CLIP);
    expect(server.calls.slice(0, 2)).toEqual(["consent old meetings", "upload me.mp4 of old"]);
  });

  it("tells why a clip was refused, and forgets whom it was for", async () => {
    const { server, underWay, enrolment } = setUp();
    server.refusal = new Problem("No space left", "Free some.", 507);
    await enrolment.start(ADA, CLIP);
    expect(enrolment.state).toMatchObject({ status: "failed", problem: { title: "No space left", detail: "Free some." } });
    expect([enrolment.canReconnect, underWay.size, server.calls.at(-1)]).toEqual([false, 0, "erase p"]);
  });

  it("says nothing more once it is left", async () => {
    const { server, enrolment, states } = setUp();
    server.hold = "upload";
    const running = enrolment.start(ADA, CLIP);
    await new Promise((resolve) => setTimeout(resolve));
    const before = states.length;
    enrolment.leave();
    await running;
    expect(states).toHaveLength(before);
  });
});
