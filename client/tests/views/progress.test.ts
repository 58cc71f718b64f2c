// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Api } from "../../src/api/api";
import type { Job, Sequence } from "../../src/api/types";
import { Enrolment } from "../../src/enrolment/enrol";
import { progressView } from "../../src/views/progress";
import { eventStream, fakeFetch, job, json, sequence, tokenStore, type Call } from "../fakes";

let close: () => void = () => undefined;

/** A training that is watched from its bookmark on; `server.job` is what the server says of it. */
function setUp(first: Partial<Job>, found: Partial<Sequence> = {}) {
  const server = { job: job(first), away: false, answer: null as ((call: Call) => Response | null) | null };
  const { request, calls } = fakeFetch((call) => {
    if (server.away) throw new TypeError("no network");
    const own = server.answer?.(call);
    if (own) return own;
    if (call.path.endsWith("/events")) return eventStream(server.job);
    if (call.path.endsWith("/preview")) return new Response("picture");
    if (call.path.startsWith("/v1/models")) return json({ metrics: {} });
    if (call.path.startsWith("/v1/sequences")) return json(sequence(found));
    return json(server.job);
  });
  const api = new Api(tokenStore("guest"), request);
  const hooks = { onMeet: vi.fn(), onAgain: vi.fn() };
  const enrolment: Enrolment = new Enrolment(api, (state) => view.show(state), () => undefined, { get: () => null, set: () => undefined });
  const view = progressView(api, enrolment, null, hooks);
  close = () => (enrolment.leave(), view.close());
  document.body.append(view.element);
  view.show(enrolment.state);
  const labels = (): string[] => [...view.element.querySelectorAll("button")].map(({ textContent }) => textContent ?? "");
  const press = async (label: string): Promise<void> => {
    [...view.element.querySelectorAll("button")].find(({ textContent }) => textContent === label)?.click();
    await vi.advanceTimersByTimeAsync(300);
  };
  const watch = async (): Promise<void> => {
    void enrolment.continueFrom({ name: "Ada", sequenceId: "s", jobId: "j" });
    await vi.advanceTimersByTimeAsync(100);
  };
  const title = (): string => view.element.querySelector("h1")?.textContent ?? "";
  const current = (): string => view.element.querySelector("[aria-current=step]")?.textContent ?? "";
  return { view, server, hooks, enrolment, calls, labels, press, watch, title, current };
}

beforeEach(() => {
  vi.useFakeTimers();
  document.body.innerHTML = '<div id="announcer"></div>';
  HTMLElement.prototype.scrollIntoView = () => undefined;
});
afterEach(() => {
  close();
  vi.useRealTimers();
});

describe("the progress of an enrolment", () => {
  it("shows the step, how far it is, and that it may be cancelled", async () => {
    const { view, labels, watch, title, current } = setUp({ progress: 0.4, message: "training" });
    await watch();
    expect([title(), current()]).toEqual(["Training your model", "Train your model"]);
    const bar = view.element.querySelector("[role=progressbar]");
    expect(bar?.getAttribute("aria-valuenow")).toBe("40");
    expect(bar?.getAttribute("aria-label")).toBe("Training your model");
    expect(labels()).toEqual(["Cancel"]);
    expect(view.busy()).toBe(true);
  });

  it("offers to meet as soon as there is a model, and keeps the focus where it is", async () => {
    const { view, server, hooks, labels, press, watch } = setUp({ progress: 0.4, model_id: "early" });
    await watch();
    expect(labels()).toEqual(["Meet", "Cancel"]);
    expect(view.element.textContent).toContain("This is a first likeness, which becomes sharper. You can join");
    const cancel = view.element.querySelector<HTMLElement>("[data-testid=cancel]");
    cancel?.focus();
    server.job = job({ progress: 0.6, model_id: "better" });
    await vi.advanceTimersByTimeAsync(5000);
    expect(document.activeElement).toBe(cancel);
    await press("Meet");
    expect(hooks.onMeet).toHaveBeenCalledWith("better");
  });

  it("is ready with the name, and is busy no more", async () => {
    const { view, labels, watch, title } = setUp({ state: "succeeded", progress: 1, model_id: "m" });
    await watch();
    expect([title(), labels(), view.busy()]).toEqual(["Ada, you are ready", ["Meet"], false]);
    expect(view.element.querySelector<HTMLElement>("[role=progressbar]")?.hidden).toBe(true);
    expect(view.element.querySelectorAll("li.done")).toHaveLength(3);
    expect(document.getElementById("announcer")?.textContent).toContain("Ada, you are ready");
  });

  it("tells of the model what was kept, once it is ready", async () => {
    const { view, server, watch } = setUp({ state: "succeeded", progress: 1, model_id: "m" });
    const size = { of: 6000, kept: 3421, tried: [] };
    server.answer = ({ path }) => (path === "/v1/models/m" ? json({ metrics: { size } }) : null);
    await watch();
    const report = view.element.querySelector<HTMLElement>("[data-testid=model-report]");
    expect([report?.hidden, report?.textContent]).toEqual([false, "Your modelPoints kept3,421 of 6,000"]);
  });

  it("stops a training, and takes it up again", async () => {
    const { server, calls, labels, press, watch, title } = setUp({ progress: 0.4 });
    await watch();
    server.answer = ({ method }) => (method === "DELETE" ? ((server.job = job({ state: "cancelled", progress: 0.4 })), new Response()) : null as never);
    await press("Cancel");
    await vi.advanceTimersByTimeAsync(5000);
    expect([title(), labels()]).toEqual(["Stopped", ["Resume", "Start again"]]);
    server.answer = ({ path }) => (path.endsWith("/resume") ? ((server.job = job({ progress: 0.5 })), new Response()) : null as never);
    await press("Resume");
    expect(calls.some(({ method, path }) => method === "POST" && path === "/v1/jobs/j/resume")).toBe(true);
    expect([title(), labels()]).toEqual(["Training your model", ["Cancel"]]);
  });

  it("says so where a training could not be stopped", async () => {
    const { view, server, press, watch } = setUp({ progress: 0.4 });
    await watch();
    server.away = true;
    await press("Cancel");
    expect(view.element.textContent).toContain("The server does not answer");
  });

  it("offers what can be done after a failure: resume, or begin anew", async () => {
    const error = { type: "", title: "Out of memory", detail: "try again", status: 500 };
    const kept = setUp({ state: "failed", error, progress: 0.4 });
    await kept.watch();
    expect([kept.title(), kept.labels()]).toEqual(["Something went wrong", ["Resume", "Start again"]]);
    expect(kept.view.element.querySelector("[role=alert]")?.textContent).toContain("Out of memory");
    close();
    const gone = setUp({ state: "failed", error, sequence_id: null });
    await gone.watch();
    expect(gone.labels()).toEqual(["Try again"]);
    await gone.press("Try again");
    expect(gone.hooks.onAgain).toHaveBeenCalledTimes(1);
  });

  it("offers to look again where the server is gone, and goes on from there", async () => {
    const { server, labels, press, watch, title } = setUp({ progress: 0.4 });
    server.away = true;
    await watch();
    await vi.advanceTimersByTimeAsync(60_000);
    expect([title(), labels()]).toEqual(["Something went wrong", ["Try again", "Start again"]]);
    server.away = false;
    await press("Try again");
    expect([title(), labels()]).toEqual(["Training your model", ["Cancel"]]);
  });

  it("tells once how good the clip is, and what would help", async () => {
    const quality = { frames_used: 60, blur: 10, advice: ["Add light."] };
    const { view, watch } = setUp({ progress: 0.4 }, { quality } as Partial<Sequence>);
    await watch();
    const report = view.element.querySelector("[data-testid=quality]");
    expect(report?.textContent).toContain("SharpnessBlurred");
    expect(report?.textContent).toContain("Add light.");
    await vi.advanceTimersByTimeAsync(5000);
    expect(report?.querySelectorAll("h2")).toHaveLength(1);
  });
});
