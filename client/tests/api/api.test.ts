import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Api } from "../../src/api/api";
import { NO_SERVER, Problem, asProblem, problemOf } from "../../src/api/problem";
import { eventStream, fakeFetch, job, json, sequence, tokenStore } from "../fakes";

const never = new AbortController().signal;

describe("tokens", () => {
  it("asks for a guest's token once, and sends it in a header", async () => {
    const { request, calls } = fakeFetch(({ path }) =>
      path === "/v1/guest" ? json({ token: "guest", expires_at: "" }, 201) : json(job()),
    );
    const api = new Api(tokenStore(null), request);
    await Promise.all([api.job("a"), api.job("b")]);
    expect(calls.filter(({ path }) => path === "/v1/guest")).toHaveLength(1);
    expect(calls.at(-1)?.token).toBe("Bearer guest");
    expect(calls.every(({ path }) => !path.includes("guest=") && !path.includes("token"))).toBe(true);
  });

  it("replaces a token that has run out, and repeats the call", async () => {
    const { request, calls } = fakeFetch(({ path, token }) => {
      if (path === "/v1/guest") return json({ token: "new", expires_at: "" }, 201);
      return token === "Bearer new" ? json(job()) : json({ title: "Token expired" }, 401);
    });
    await new Api(tokenStore("old"), request).job("a");
    expect(calls.map(({ token }) => token)).toEqual(["Bearer old", "Bearer old", "Bearer new"]);
  });

  it("says that an invitation is needed where guests are not let in", async () => {
    const { request } = fakeFetch(() => json({ title: "Forbidden" }, 403));
    await expect(new Api(tokenStore(null), request).job("a")).rejects.toMatchObject({
      title: "You need an invitation",
      status: 403,
    });
  });
});

describe("failures", () => {
  it("tells a problem in the server's words, as a sentence", async () => {
    const details = { title: "No such job", detail: "id must be a known job; got 'x'", status: 404 };
    const { request } = fakeFetch(() => json(details, 404));
    const failure = await new Api(tokenStore("t"), request).job("x").catch((e: unknown) => e);
    expect(failure).toBeInstanceOf(Problem);
    expect(failure).toMatchObject({
      title: "No such job",
      detail: "Id must be a known job; got 'x'.",
      status: 404,
    });
  });

  it("tells a missing server apart", async () => {
    const { request } = fakeFetch(() => Promise.reject(new TypeError("Failed to fetch")));
    await expect(new Api(tokenStore("t"), request).job("x")).rejects.toBe(NO_SERVER);
    expect(problemOf(502, "<html>")).toBe(NO_SERVER);
  });

  it("has words for answers without a problem document", () => {
    expect(problemOf(413, "<html>").title).toBe("The file is too large");
    expect(problemOf(418, "").detail).toBe("The server answered 418.");
    expect(problemOf(503, "", "7").retryAfterS).toBe(7);
    expect(asProblem(new Error("x is undefined")).detail).toBe("X is undefined.");
  });

  it("takes a missing demo for no demo, and nothing else", async () => {
    const none = fakeFetch(() => json({ meeting_id: null }));
    expect(await new Api(tokenStore("t"), none.request).demoMeeting()).toBeNull();
    const broken = fakeFetch(() => json({ title: "Broken" }, 500));
    await expect(new Api(tokenStore("t"), broken.request).demoMeeting()).rejects.toThrow("Broken");
  });
});

describe("watchJob", () => {
  beforeEach(() => {
    vi.useFakeTimers();
  });
  afterEach(() => {
    vi.useRealTimers();
  });

  it("opens a broken stream again and returns the final job", async () => {
    let streams = 0;
    const done = job({ state: "succeeded", progress: 1, model_id: "m" });
    const { request } = fakeFetch(({ path }) => {
      if (!path.endsWith("/events")) return json(streams > 1 ? done : job({ progress: 0.4 }));
      streams += 1;
      return streams === 1 ? eventStream(job({ progress: 0.3 })) : eventStream(job(), done);
    });
    const seen: number[] = [];
    const watching = new Api(tokenStore("t"), request).watchJob(
      "j",
      ({ progress }) => seen.push(progress),
      never,
    );
    await vi.runAllTimersAsync();
    expect(await watching).toEqual(done);
    expect(streams).toBe(2);
    expect(seen).toContain(0.3);
    expect(seen.at(-1)).toBe(1);
  });

  it("gives up on a server that stays away, and at once on an unknown job", async () => {
    const away = fakeFetch(() => Promise.reject(new TypeError("Failed to fetch")));
    const watching = new Api(tokenStore("t"), away.request).watchJob("j", () => undefined, never);
    const outcome = watching.catch((error: unknown) => error);
    await vi.runAllTimersAsync();
    expect(await outcome).toBe(NO_SERVER);
    expect(away.calls.length).toBeGreaterThan(3);
    const gone = fakeFetch(() => json({ title: "No such job" }, 404));
    const api = new Api(tokenStore("t"), gone.request);
    await expect(api.watchJob("j", () => undefined, never)).rejects.toThrow("No such job");
    expect(gone.calls).toHaveLength(1);
  });

  it("stops when told to", async () => {
    const stopping = new AbortController();
    const { request } = fakeFetch(() => json(job()));
    const watching = new Api(tokenStore("t"), request).watchJob("j", () => undefined, stopping.signal);
    const outcome = watching.catch((error: unknown) => error);
    await vi.advanceTimersByTimeAsync(100);
    stopping.abort("enough");
    expect(await outcome).toBe("enough");
  });
});

describe("uploads", () => {
  const clip = { filename: "me.mp4", size: 4, sha256: "0".repeat(64) };
  const bytes = new TextEncoder().encode("clip").buffer;

  it("are begun by what the file is", async () => {
    const { request, calls } = fakeFetch(() => json({ id: "u", offset: 3 }, 201));
    expect(await new Api(tokenStore("t"), request).beginUpload("p", clip, never)).toEqual({ id: "u", offset: 3 });
    expect(calls[0]).toMatchObject({ method: "POST", path: "/v1/people/p/uploads", token: "Bearer t", body: JSON.stringify(clip) });
  });

  it("go on with bytes from an offset, until the answer is the sequence", async () => {
    const sent: RequestInit[] = [];
    const answers = [new Response(null, { status: 204, headers: { "Upload-Offset": "4" } }), json(sequence(), 202)];
    const request: typeof fetch = async (_, init) => (sent.push(init as RequestInit), answers.shift() as Response);
    const api = new Api(tokenStore("t"), request);
    expect(await api.sendPiece({ id: "u", offset: 0 }, bytes)).toBe(4);
    expect(await api.sendPiece({ id: "u", offset: 4 }, bytes)).toEqual(sequence());
    expect(sent.map(({ body }) => body)).toEqual([bytes, bytes]);
    expect(sent.map(({ headers }) => new Headers(headers).get("Upload-Offset"))).toEqual(["0", "4"]);
  });

  it("stop when told to, and say so where the server says nothing for long", async () => {
    const hang: typeof fetch = (_, init) =>
      new Promise((_, reject) => init?.signal?.addEventListener("abort", () => reject(init.signal?.reason)));
    const silence = new AbortController();
    vi.spyOn(AbortSignal, "timeout").mockReturnValue(silence.signal);
    const stopping = new AbortController();
    const api = new Api(tokenStore("t"), hang);
    const [stopped, silent] = [api.sendPiece({ id: "u", offset: 0 }, bytes, stopping.signal), api.beginUpload("p", clip, never)];
    await Promise.resolve();
    stopping.abort("enough");
    await expect(stopped).rejects.toBe("enough");
    silence.abort();
    await expect(silent).rejects.toBe(NO_SERVER);
    vi.restoreAllMocks();
  });
});
