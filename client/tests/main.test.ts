// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { fakeFetch, json, type Call } from "./fakes";
import { FakeSocket } from "./fakeSocket";
import { FRONT } from "./viewpoint/front";

const MEETING = { id: "m", name: "Monday", join_url: "/?meeting=m", environment: "studio", performers: [], viewpoint: FRONT, lobby: true };
const SEAT = { token: "seat", gateway_url: "", control_url: "/v1/meetings/m/control", whep_url: "/whep/m", ice_servers: [], ready: true, performers: [], viewpoint: FRONT };

class ControlSocket extends FakeSocket {
  static made: ControlSocket[] = [];
  sent: Record<string, unknown>[] = [];
  constructor(readonly address: string) {
    super();
    ControlSocket.made.push(this);
  }
  send(text: string): void {
    this.sent.push(JSON.parse(text) as Record<string, unknown>);
  }
  close(): void {
    this.readyState = 3;
  }
}

let answer: (call: Call) => Response | null;
let calls: Call[];

function server({ path }: Call): Response {
  if (path === "/v1/guest") return json({ token: "guest" });
  if (path === "/v1/demo") return json({ meeting_id: "m" });
  if (path === "/v1/meetings/m") return json(MEETING);
  if (path.endsWith("/join")) return json(SEAT);
  if (path.endsWith("/home")) return json({ gateway_url: "" });
  return json({ items: [] });
}

/** Open the page at `address`, as a fresh tab or a reload does. */
async function open(address: string): Promise<HTMLElement> {
  history.replaceState(null, "", address);
  document.body.innerHTML = '<div id="page"></div><div id="announcer"></div>';
  vi.resetModules();
  await import("../src/main");
  await vi.advanceTimersByTimeAsync(50);
  return document.getElementById("page") as HTMLElement;
}

const find = <Kind extends HTMLElement>(page: HTMLElement, testId: string): Kind => {
  const found = page.querySelector<Kind>(`[data-testid="${testId}"]`);
  if (!found) throw new Error(`${testId} is not in “${page.textContent}”`);
  return found;
};
const press = async (page: HTMLElement, label: string): Promise<void> => {
  [...page.querySelectorAll("button")].find(({ textContent }) => textContent === label)?.click();
  await vi.advanceTimersByTimeAsync(50);
};
const join = async (page: HTMLElement, name: string): Promise<ControlSocket> => {
  find<HTMLInputElement>(page, "join-name").value = name;
  find(page, "start-join").closest("form")?.dispatchEvent(new Event("submit", { cancelable: true }));
  await vi.advanceTimersByTimeAsync(50);
  const socket = ControlSocket.made.at(-1) as ControlSocket;
  socket.onopen();
  return socket;
};
/** The server lets us into the lobby. */
const wait = async (socket: ControlSocket): Promise<void> => {
  const me = { id: "me", name: "Ada", role: "speaker", admission: "waiting", present: true, hand_at: null, microphone: false, performer_id: null, connection: null };
  socket.say({ type: "welcome", participant_id: "me", seat: 1, silence_s: 5 });
  socket.say({ type: "roster", lobby: true, environment: "studio", presenter_id: null, presenter_asks_id: null, recording: null, members: [me], performer_ids: [] });
  await vi.advanceTimersByTimeAsync(50);
};

beforeEach(() => {
  vi.useFakeTimers();
  sessionStorage.clear();
  localStorage.clear();
  ControlSocket.made = [];
  answer = () => null;
  const fake = fakeFetch((call) => answer(call) ?? server(call));
  calls = fake.calls;
  vi.stubGlobal("fetch", fake.request);
  vi.stubGlobal("WebSocket", ControlSocket);
  vi.stubGlobal("scrollTo", () => undefined);
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("opening the page", () => {
  it("offers the demo's meeting as a guest, and keeps the guest's token over a reload", async () => {
    const page = await open("/");
    expect(find(page, "start-join").textContent).toBe("Ask to join");
    expect(localStorage.getItem("metanerf.token")).toBe("guest");
    await open("/");
    expect(calls.filter(({ path }) => path === "/v1/guest")).toHaveLength(1);
  });

  it("takes an invitation's token from the address, for this tab only, and out of sight", async () => {
    await open("/?meeting=m#token=invited");
    expect(location.hash).toBe("");
    expect(calls.find(({ path }) => path !== "/v1/access")).toMatchObject({ path: "/v1/meetings/m", token: "Bearer invited" });
    expect([sessionStorage.getItem("metanerf.token"), localStorage.getItem("metanerf.token")]).toEqual(["invited", null]);
  });

  it("takes a sealed meeting's key from the address, out of sight and into no request", async () => {
    await open("/?meeting=m#token=invited&key=AAECAwQFBgcICQoLDA0ODw");
    expect(location.hash).toBe("");
    expect(sessionStorage.getItem("metanerf.key.m")).toBe("AAECAwQFBgcICQoLDA0ODw");
    expect(sessionStorage.getItem("metanerf.token")).toBe("invited");
    expect(JSON.stringify(calls)).not.toContain("AAECAwQF");
  });

  it("shows no picture of a sealed meeting before one is in it, though the server denies that it is one", async () => {
    answer = ({ path }) => (path === "/v1/meetings/m" ? json({ ...MEETING, lobby: false }) : null);
    const page = await open("/?meeting=m#key=AAECAwQFBgcICQoLDA0ODw");
    expect(find(page, "start-join").textContent).toBe("Join the meeting");
    expect(page.textContent).toContain("only people with the whole link see each other move");
    expect(calls.some(({ path }) => path.includes("whep"))).toBe(false);
  });

  it("says before one joins that a sealed meeting's link lacks its key, or has none that is one", async () => {
    answer = ({ path }) => (path === "/v1/meetings/m" ? json({ ...MEETING, sealed: true }) : null);
    for (const address of ["/?meeting=m", "/?meeting=m#key=cut"]) {
      expect((await open(address)).textContent).toContain("This link lacks the meeting’s key");
    }
  });

  it("starts with one's own model where the server runs no demo", async () => {
    answer = ({ path }) => (path === "/v1/demo" ? json({ meeting_id: null }) : null);
    const page = await open("/");
    expect(page.textContent).toContain("Start with your model");
    expect(page.querySelector("[data-testid=start-join]")).toBeNull();
  });

  it("says what is wrong, tries again, and leads away from a meeting that is gone", async () => {
    let gone = true;
    answer = ({ path }) => (gone && path === "/v1/meetings/x" ? json({ title: "No such meeting", detail: "it has ended" }, 404) : null);
    const page = await open("/?meeting=x");
    expect(find(page, "error").textContent).toContain("No such meeting");
    await press(page, "Try again");
    expect(calls.filter(({ path }) => path === "/v1/meetings/x")).toHaveLength(2);
    gone = false;
    await press(page, "Go to the start");
    expect(location.search).toBe("");
    expect(find(page, "start-join").textContent).toBe("Ask to join");
  });

  it("shows recordings at their address", async () => {
    const page = await open("/?recordings");
    await vi.dynamicImportSettled();
    await vi.advanceTimersByTimeAsync(50);
    expect(page.textContent).toContain("Nothing has been recorded yet.");
    expect(calls.map(({ path }) => path)).toContain("/v1/recordings");
  });

  it("goes on with an enrolment that was under way", async () => {
    sessionStorage.setItem("metanerf.enrolment", JSON.stringify({ name: "Ada", sequenceId: "s", jobId: null }));
    answer = ({ path }) => (path === "/v1/sequences/s" ? json({ title: "The clip is gone", detail: "" }, 404) : null);
    const page = await open("/");
    expect(page.textContent).toContain("The clip is gone");
    // what can't be taken up again does not come back
    expect(sessionStorage.getItem("metanerf.enrolment")).toBeNull();
  });
});

describe("signing in", () => {
  const keys = (store: Storage): string[] => Object.keys(store).filter((key) => key.startsWith("metanerf."));
  /** A server with a provider; who brings this token is signed in. */
  const provider = (guests: boolean) => ({ path, token }: Call): Response | null => {
    if (path === "/v1/access") return json({ guests, login: true });
    if (path === "/v1/login/token") return json({ token: "signed-in", expires_at: "", name: "Ada <b>" });
    if (path === "/v1/guest") return guests ? json({ token: "guest" }) : json({ title: "No" }, 403);
    return token === "Bearer old" ? json({ title: "Over" }, 401) : null;
  };
  let left: string[];

  beforeEach(() => {
    left = [];
    vi.spyOn(location, "assign").mockImplementation((address) => void left.push(String(address)));
  });
  afterEach(() => void vi.restoreAllMocks());

  it("is offered where guests are not let in, and leads back to where one was", async () => {
    answer = provider(false);
    const page = await open("/?meeting=m&size=256#key=AAECAwQFBgcICQoLDA0ODw");
    expect(page.textContent).toContain("Sign in to meet");
    expect(page.querySelector("[data-testid=as-guest]")).toBeNull();
    find(page, "sign-in-here").click();
    expect(left).toEqual(["/v1/login?to=%2F%3Fmeeting%3Dm%26size%3D256"]);
    // the key of a sealed meeting waits here, and goes nowhere
    expect(sessionStorage.getItem("metanerf.key.m")).toBe("AAECAwQFBgcICQoLDA0ODw");
  });

  it("takes the token on the way back, shows the name as text, and lets no token into an address", async () => {
    answer = provider(false);
    const page = await open("/?meeting=m#login=done");
    expect([location.hash, location.search]).toEqual(["", "?meeting=m"]);
    expect(calls.find(({ path }) => path === "/v1/meetings/m")?.token).toBe("Bearer signed-in");
    expect(find(page, "account").textContent).toBe("Ada <b>Sign out");
    expect(find(page, "account").querySelector("b")).toBeNull();
    expect(find<HTMLInputElement>(page, "join-name").value).toBe("Ada <b>");
    expect(calls.some(({ path }) => path === "/v1/guest")).toBe(false);
    expect(find((await open("/?meeting=m")), "sign-out")).toBeTruthy();
  });

  it("ends with nothing left of whoever was here", async () => {
    answer = provider(true);
    const page = await open("/?meeting=m#login=done");
    sessionStorage.setItem("metanerf.host.m", "host");
    localStorage.setItem("another", "page");
    find(page, "sign-out").click();
    await vi.advanceTimersByTimeAsync(50);
    expect(left).toEqual(["/v1/logout"]);
    expect([...keys(sessionStorage), ...keys(localStorage)]).toEqual([]);
    expect(localStorage.getItem("another")).toBe("page");
  });

  it.each([
    ["denied", "You were not signed in"],
    ["stale", "You are not signed in yet"],
    ["away", "Nobody can sign in at the moment"],
    ["fault", "Signing in does not work"],
    ["<img>", "You are not signed in yet"],
  ])("says why it came to nothing: %s", async (word, words) => {
    answer = provider(true);
    const page = await open(`/?meeting=m#login=${encodeURIComponent(word)}`);
    expect(find(page, "error").textContent).toContain(words);
    expect(localStorage.getItem("metanerf.token")).toBeNull();
    find(page, "as-guest").click();
    await vi.advanceTimersByTimeAsync(50);
    expect(localStorage.getItem("metanerf.token")).toBe("guest");
    expect(find(page, "sign-in").textContent).toBe("Sign in");
  });

  it("is not done by a link that somebody else has sent", async () => {
    answer = (call) => (call.path === "/v1/login/token" ? json({ title: "Login stale" }, 400) : provider(true)(call));
    const page = await open("/?meeting=m#login=done");
    expect(find(page, "error").textContent).toContain("You are not signed in yet");
    expect(localStorage.getItem("metanerf.token")).toBeNull();
  });

  it("is asked for again once it is over: nobody becomes a guest unasked", async () => {
    answer = provider(true);
    localStorage.setItem("metanerf.token", "old");
    localStorage.setItem("metanerf.account", "Ada");
    for (let visit = 0; visit < 2; visit++) {
      const page = await open("/?meeting=m");
      expect(find(page, "error").textContent).toContain("You are no longer signed in");
      expect(calls.some(({ path }) => path === "/v1/guest")).toBe(false);
    }
    find(document.body, "as-guest").click();
    await vi.advanceTimersByTimeAsync(50);
    expect(localStorage.getItem("metanerf.token")).toBe("guest");
  });

  it("is out of sight for whoever comes by an invitation's token", async () => {
    answer = provider(false);
    localStorage.setItem("metanerf.token", "signed-in");
    localStorage.setItem("metanerf.account", "Ada");
    const page = await open("/?meeting=m#token=invited");
    expect(calls.find(({ path }) => path === "/v1/meetings/m")?.token).toBe("Bearer invited");
    expect(find(page, "account").textContent).toBe("Sign in");
  });

  it("is not offered where the server has no provider", async () => {
    const page = await open("/");
    expect(find(page, "account").textContent).toBe("");
  });
});

describe("joining a meeting with a lobby", () => {
  it("says hello by name, waits, and leaves again", async () => {
    const page = await open("/");
    const socket = await join(page, "Ada");
    expect(socket.sent[0]).toMatchObject({ type: "hello", token: "seat", name: "Ada", after: 0 });
    await wait(socket);
    expect(page.textContent).toContain("Waiting to be let in");
    expect(calls.some(({ path }) => path.includes("whep"))).toBe(false);
    find(page, "lobby-leave").click();
    await vi.advanceTimersByTimeAsync(50);
    expect(socket.sent.at(-1)).toEqual({ type: "leave" });
    expect(find<HTMLInputElement>(page, "join-name").value).toBe("Ada");
  });

  it("keeps name and seat over a reload", async () => {
    await wait(await join(await open("/"), "Ada"));
    const joined = calls.filter(({ path }) => path.endsWith("/join")).length;
    const page = await open("/");
    const again = ControlSocket.made.at(-1) as ControlSocket;
    again.onopen();
    expect(again.sent[0]).toMatchObject({ type: "hello", token: "seat", name: "Ada" });
    expect(calls.filter(({ path }) => path.endsWith("/join"))).toHaveLength(joined);
    await wait(again);
    expect(page.textContent).toContain("Waiting to be let in");
  });

  it("says that one was not let in, and starts anew from there", async () => {
    const page = await open("/");
    const socket = await join(page, "Ada");
    await wait(socket);
    socket.say({ type: "goodbye", reason: "denied", problem: null });
    socket.onclose();
    await vi.advanceTimersByTimeAsync(50);
    expect(find(page, "goodbye-denied").textContent).toContain("You were not let in");
    expect(sessionStorage.getItem("metanerf.seat")).toBeNull();
    find(page, "goodbye-back").click();
    await vi.advanceTimersByTimeAsync(50);
    expect(find(page, "start-join").textContent).toBe("Ask to join");
  });

  it("goes on here, on the same seat, after another tab took over", async () => {
    const page = await open("/");
    const socket = await join(page, "Ada");
    await wait(socket);
    socket.say({ type: "goodbye", reason: "replaced", problem: null });
    socket.onclose();
    await vi.advanceTimersByTimeAsync(50);
    await press(page, "Continue here");
    const again = ControlSocket.made.at(-1) as ControlSocket;
    again.onopen();
    expect(again).not.toBe(socket);
    expect(again.sent[0]).toMatchObject({ type: "hello", token: "seat", name: "Ada" });
  });

  it("forgets the address of a meeting that has ended", async () => {
    const page = await open("/?meeting=m");
    const socket = await join(page, "Ada");
    await wait(socket);
    socket.say({ type: "goodbye", reason: "ended", problem: null });
    socket.onclose();
    await vi.advanceTimersByTimeAsync(50);
    expect(find(page, "goodbye-ended").textContent).toContain("The meeting is over");
    find(page, "goodbye-back").click();
    await vi.advanceTimersByTimeAsync(50);
    expect(location.search).toBe("");
  });
});
