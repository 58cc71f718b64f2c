import { describe, expect, it } from "vitest";
import { Api } from "../../src/api/api";
import { MeetingSession, socketAddress, type StoredSeat } from "../../src/meeting/session";
import type { ControlConnection, ControlHooks } from "../../src/meeting/controlConnection";
import type { Meeting, MeetingHome, Seat, ToServer } from "../../src/api/types";
import { fakeFetch, json, member, tokenStore } from "../fakes";

const MEETING = { id: "m", name: "Monday", join_url: "/", performers: [], lobby: false } as unknown as Meeting;

/** `homes`: what the server says, one after the other, of where the meeting lives. */
function setUp(tokens = tokenStore("guest"), homes: string[] = []) {
  let seats = 0;
  const { request, calls } = fakeFetch((call) =>
    call.path.endsWith("/join")
      ? json({ token: `seat${++seats}`, gateway_url: "https://one.example" } as Partial<Seat>)
      : call.path.endsWith("/home") ? json({ gateway_url: homes.shift() } as MeetingHome) : json({ ...MEETING, host_token: "host" }),
  );
  const api = new Api(tokens, request);
  let ticket: StoredSeat | null = null;
  const sent: ToServer[] = [];
  let hooks: ControlHooks | null = null;
  const line = {
    run: async () => undefined,
    send: (message: ToServer) => sent.push(message) > 0,
    close: () => undefined,
  };
  const session = new MeetingSession(
    api,
    MEETING,
    { get: () => ticket, set: (next) => void (ticket = next) },
    (given) => ((hooks = given), line as unknown as ControlConnection),
  );
  (globalThis as { location?: { href: string } }).location ??= { href: "http://localhost/" };
  return { api, session, calls, sent, hooks: () => hooks as unknown as ControlHooks, ticket: () => ticket };
}

describe("MeetingSession", () => {
  it("keeps one seat for the picture and the line, and a ticket to take it up again", async () => {
    const { session, hooks, ticket, calls } = setUp();
    expect((await session.getSeat()).token).toBe("seat1");
    expect(ticket()).toBeNull(); // only looking so far
    session.join("Ada");
    expect(await hooks().hello(false)).toMatchObject({ token: "seat1", name: "Ada", after: 0 });
    expect(ticket()).toMatchObject({ meetingId: "m", name: "Ada", seat: { token: "seat1" } });
    expect(await hooks().hello(true)).toMatchObject({ token: "seat2" });
    expect((await session.getSeat()).token).toBe("seat2");
    expect(calls.filter(({ path }) => path.endsWith("/join"))).toHaveLength(2);
  });

  it("sits on one seat, however many ask for it at once", async () => {
    const { session, calls } = setUp();
    const asked = await Promise.all([session.getSeat(), session.getSeat(), session.getSeat(true)]);
    expect(asked.map(({ token }) => token)).toEqual(["seat1", "seat1", "seat1"]);
    expect(calls.filter(({ path }) => path.endsWith("/join"))).toHaveLength(1);
  });

  it("says which seat the control connection holds, once it does", async () => {
    const { session, hooks } = setUp();
    await session.getSeat(); // the preview's, whose end gives it back
    session.join("Ada");
    const held: string[] = [];
    const ask = async (): Promise<void> => void held.push((await session.heldSeat()).token);
    const asked = [ask(), ask()];
    await hooks().hello(false);
    hooks().onState({ kind: "lost" });
    await hooks().hello(true);
    await Promise.resolve();
    expect(held).toEqual([]);
    hooks().onState({ kind: "open" });
    await Promise.all(asked);
    expect(held).toEqual(["seat2", "seat2"]);
    // it waits for us while the connection is lost
    hooks().onState({ kind: "lost" });
    await ask();
    expect(held.at(-1)).toBe("seat2");
  });

  it("goes on from the ticket of an earlier load", async () => {
    const { session, hooks, calls } = setUp(undefined, ["https://two.example"]);
    const seat = { token: "kept", gateway_url: "https://one.example" } as Seat;
    session.join("Ada", { meetingId: "m", name: "Ada", seat, lastRead: 0 });
    const address = "wss://two.example/v1/meetings/m/control"; // the meeting may have moved since
    expect(await hooks().hello(false)).toMatchObject({ token: "kept", address });
    expect(calls.map(({ path, token }) => [path, token])).toEqual([["/v1/meetings/m/home", "Bearer kept"]]);
  });

  it("goes where the meeting lives, and asks anew once a connection was lost", async () => {
    const { session, hooks, calls } = setUp(undefined, ["https://two.example", ""]);
    const heard: (string | null)[] = [];
    session.subscribe(() => heard.push(session.home));
    session.join("Ada");
    expect((await hooks().hello(false)).address).toBe("wss://one.example/v1/meetings/m/control");
    expect(await session.addressOf("/whep/m", false)).toBe("https://one.example/whep/m");
    expect(calls.filter(({ path }) => path.endsWith("/home"))).toHaveLength(0);
    expect((await hooks().hello(false)).address).toBe("wss://two.example/v1/meetings/m/control");
    expect(await session.addressOf("/whep/m", false)).toBe("https://two.example/whep/m");
    expect(heard).toEqual([null, "https://one.example", "https://two.example"]);
    // no gateway has an address of its own: the one that the page comes from
    expect(await session.addressOf("/whep/m", true)).toBe(new URL("/whep/m", location.href).href);
  });

  it("knows after a reload what was read before", async () => {
    const { session, hooks, ticket } = setUp();
    session.join("Ada");
    await hooks().hello(false);
    hooks().onMessage({ type: "said", number: 7, participant_id: "Bo", name: "Bo", text: "Hello", at: "" });
    expect(session.lastRead).toBe(0);
    session.markRead();
    const left = ticket();
    expect(left?.lastRead).toBe(7);
    const { session: back } = setUp();
    back.join("Ada", left);
    expect(back.lastRead).toBe(7);
  });

  it("is in once the host has let us in, and tells what changes", async () => {
    const { session, hooks } = setUp();
    const news: string[] = [];
    session.onAnnouncement = (words) => news.push(words);
    let changes = 0;
    const release = session.subscribe(() => changes++);
    session.join("Ada");
    const hear = hooks().onMessage;
    hear({ type: "welcome", participant_id: "me", seat: 1, silence_s: 5 });
    hear({ type: "roster", lobby: true, environment: "studio", presenter_id: null, presenter_asks_id: null, recording: null, members: [member({ id: "me", admission: "waiting" })], performer_ids: [] });
    expect(session.admitted).toBe(false);
    hear({ type: "roster", lobby: true, environment: "studio", presenter_id: null, presenter_asks_id: null, recording: null, members: [member({ id: "me" })], performer_ids: [] });
    expect(session.admitted).toBe(true);
    hear({ type: "roster", lobby: true, environment: "studio", presenter_id: null, presenter_asks_id: null, recording: null, members: [member({ id: "me" }), member({ id: "Bo" })], performer_ids: [] });
    expect(news).toEqual(["Bo joined"]);
    expect(changes).toBe(5);
    release();
  });

  it("knows how well the network carries it, and tells the server and who listens", async () => {
    const { session, hooks, sent } = setUp();
    session.join("Ada");
    hooks().onMessage({ type: "welcome", participant_id: "me", seat: 1, silence_s: 5 });
    hooks().onMessage({ type: "roster", lobby: false, environment: "studio", presenter_id: null, presenter_asks_id: null, recording: null, members: [member({ id: "me" })], performer_ids: [] });
    const heard: string[] = [];
    session.subscribe(() => heard.push(session.network));
    for (let beat = 0; beat < 5; beat++) hooks().onRoundTrip(500);
    for (let beat = 0; beat < 5; beat++) hooks().onRoundTrip(20);
    expect(heard).toEqual(["good", "poor", "good"]);
    expect(sent).toEqual([
      { type: "network", connection: "poor" },
      { type: "network", connection: "good" },
    ]);
  });

  it("gives the seat and the ticket back when leaving", async () => {
    const { session, hooks, ticket, sent } = setUp();
    session.join("Ada");
    await hooks().hello(false);
    expect(session.left).toBe(false);
    session.leave();
    expect(session.left).toBe(true);
    expect(sent).toEqual([{ type: "leave" }]);
    expect(ticket()).toBeNull();
  });

  it("joins the meetings that we opened as their host", async () => {
    const { api, session, calls } = setUp();
    expect(await api.createMeeting("Monday", [])).toEqual(MEETING);
    await session.getSeat();
    expect(calls.at(-1)?.token).toBe("Bearer host");
  });
});

describe("socketAddress", () => {
  it("is as safe as that of the gateway", () => {
    expect(socketAddress("https://meet.example/c")).toBe("wss://meet.example/c");
    expect(socketAddress("http://127.0.0.1:8000/c")).toBe("ws://127.0.0.1:8000/c");
  });
});
