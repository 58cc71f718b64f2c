/** The page: which screen is shown, and what leads from one to the next. */

import "./style/tokens.css";
import "./style/base.css";
import "./style/start.css";
import "./style/progress.css";
import "./style/stage.css";
import "./style/replay.css";
import "./style/meeting.css";
import "./style/panel.css";
import "./style/more.css";
import "./style/devices.css";
import "./style/self.css";
import "./style/screens.css";
import { Api, type TokenStore } from "./api/api";
import { chosenDevices } from "./capture/devices";
import { Enrolment, type Bookmark, type Clip } from "./enrolment/enrol";
import { everybody, meetMoving, type Somebody } from "./enrolment/keypoints";
import { LiveView } from "./drawing/live";
import { Attendance, type Ticket, type TicketStore } from "./meeting/attendance";
import type { ControlState } from "./meeting/controlConnection";
import { myself } from "./meeting/state";
import { Problem, asProblem } from "./api/problem";
import type { Meeting, NewPerson } from "./api/types";
import { h, prefersStillness } from "./views/dom";
import { goodbyeView, lobbyView } from "./views/lobby";
import { meetingTools } from "./views/meetingTools";
import { progressView, type ProgressView } from "./views/progress";
import { button, header, notice, type View } from "./views/shell";
import { stageView } from "./views/stage";
import { startView } from "./views/start";
import { enterVrButton } from "./xr/enterButton";

const TOKEN_KEY = "metanerf.token";
const BOOKMARK_KEY = "metanerf.enrolment";
const HOST_KEY = "metanerf.host.";
const TICKET_KEY = "metanerf.seat";
const NAME_KEY = "metanerf.name";
const GUEST = "Guest";

const tokens: TokenStore = {
  // an invitation's token is for this tab; who we are as a guest, for this browser
  get: () => sessionStorage.getItem(TOKEN_KEY) ?? localStorage.getItem(TOKEN_KEY),
  set: (token) => {
    sessionStorage.removeItem(TOKEN_KEY);
    if (token === null) localStorage.removeItem(TOKEN_KEY);
    else localStorage.setItem(TOKEN_KEY, token);
  },
  getHost: (meetingId) => sessionStorage.getItem(HOST_KEY + meetingId),
  setHost: (meetingId, token) => sessionStorage.setItem(HOST_KEY + meetingId, token),
};
const tickets: TicketStore = {
  get: () => readStored<Ticket>(TICKET_KEY),
  set: (ticket) => writeStored(TICKET_KEY, ticket),
};
const query = new URLSearchParams(location.search);
const api = new Api(tokens);
const page = document.getElementById("page") as HTMLElement;

let shown: View | null = null;
let live: LiveView | null = null;
let attendance: Attendance | null = null;
let underWay: ProgressView | null = null;

takeTokenFromAddress();
addEventListener("hashchange", () => takeTokenFromAddress() && location.reload());
const bookmark = readStored<Bookmark>(BOOKMARK_KEY);
if (query.has("recording")) void showRecording(query.get("recording") ?? "");
else if (query.has("recordings")) void showRecordings();
else if (bookmark) watch(null, (enrolment) => enrolment.revisit(bookmark));
else void start();

/** The first screen, with a look into the meeting if there is one. */
async function start(): Promise<void> {
  leaveMeeting();
  show({ element: h("main", { className: "opening" }, h("span", { className: "spinner" })), close: nothing });
  try {
    const meeting = await meetingToJoin();
    const ticket = tickets.get();
    // after a reload we sit where we sat
    if (meeting && ticket?.meetingId === meeting.id) return come(meeting, ticket.name, ticket);
    if (meeting) attendance = new Attendance(api, meeting, tickets);
    if (attendance && !meeting?.lobby) {
      live = look(attendance);
      live.swaying = true;
    }
    const name = localStorage.getItem(NAME_KEY) ?? "";
    const hooks = { name, onJoin: join, onEnrol: enrol, everybody: () => everybody(api), onMove: move };
    show(startView(api, meeting, live, hooks));
    live?.start();
  } catch (error) {
    showProblem(asProblem(error));
  }
}

/** A recorded meeting, as whoever agreed to it may see it again. */
async function showRecording(id: string): Promise<void> {
  try {
    const { loadRecording } = await import("./replay/load");
    const { replayView } = await import("./replay/view");
    show(replayView(api, await loadRecording(api, id), { onLeave: () => location.assign("/?recordings") }));
  } catch (error) {
    showProblem(asProblem(error), () => void showRecording(id));
  }
}

async function showRecordings(): Promise<void> {
  try {
    const { recordingsView } = await import("./replay/list");
    show(recordingsView(await api.recordings()));
  } catch (error) {
    showProblem(asProblem(error), () => void showRecordings());
  }
}

/** The meeting of the link, else the demo's. */
async function meetingToJoin(): Promise<Meeting | null> {
  const id = query.get("meeting") ?? (await api.demoMeeting());
  return id === null ? null : api.meeting(id);
}

function look(there: Attendance): LiveView {
  const size = Number(query.get("size"));
  const pinned = Number.isInteger(size) && size >= 128 && size <= 1024 ? size : null;
  // once we are in, the line to the others is what renews a seat
  const seat = (stale: boolean): ReturnType<Attendance["getSeat"]> =>
    there.getSeat(stale && !there.entered);
  return new LiveView(api, there.meeting, { seat, pinned, stamped: query.has("stamp"), inertia: !prefersStillness() });
}

/** From the first look into the meeting itself: same seat, same connection, larger picture. */
function join(name: string): void {
  if (name !== "") localStorage.setItem(NAME_KEY, name);
  if (!attendance) return;
  attendance.comesHeard = chosenDevices().heard;
  attendance.enter(name || GUEST);
  attend(attendance);
}

function come(meeting: Meeting, name: string, ticket: Ticket | null = null): void {
  leaveMeeting();
  attendance = new Attendance(api, meeting, tickets);
  attendance.enter(name, ticket);
  attend(attendance);
}

/** Show where we are: before the door, waiting behind it, inside, or out again. */
function attend(there: Attendance): void {
  let place: "door" | "lobby" | "inside" = "door";
  const go = (next: "lobby" | "inside"): void => {
    if (place === next) return;
    place = next;
    if (next === "inside") goInside(there);
    else waitBefore(there);
  };
  // who has had a look already need not wait for the line
  if (live) go("inside");
  there.watch(() => {
    if (attendance !== there) return;
    if (there.line.kind === "over") sayGoodbye(there, there.line);
    else if (there.admitted) go("inside");
    else if (myself(there.state)) go("lobby");
  });
}

function goInside(there: Attendance): void {
  const looking = live ?? look(there);
  const isNew = looking !== live;
  live = looking;
  const again = (): void => (giveUpSeat(), come(there.meeting, localStorage.getItem(NAME_KEY) || GUEST));
  const tools = meetingTools(api, there);
  const headset = enterVrButton(looking, there, { microphone: tools.toggleMicrophone, leave: goOut });
  show(stageView(looking, tools, headset, { onLeave: goOut, onRetry: again }));
  looking.takeOver();
  if (isNew) looking.start();
  let wasOpen = true;
  there.watch(() => {
    const isOpen = there.line.kind === "open";
    if (isOpen && !wasOpen) looking.hurry();
    wasOpen = isOpen;
    if (there.admitted) void looking.showPlace(there.state.environment);
  });
}

function waitBefore(there: Attendance): void {
  live?.close();
  live = null;
  show(lobbyView(there, goOut));
}

function sayGoodbye(there: Attendance, { reason, problem }: Extract<ControlState, { kind: "over" }>): void {
  leaveMeeting();
  const ticket = tickets.get();
  const onHere = (): void => come(there.meeting, ticket?.name ?? GUEST, ticket);
  const onBack = (): void => {
    tickets.set(null);
    // to what is over nobody comes back
    if (reason === "ended") setMeeting(null);
    void start();
  };
  show(goodbyeView(reason, problem, { onBack, onHere }));
}

function goOut(): void {
  giveUpSeat();
  void start();
}

function giveUpSeat(): void {
  attendance?.leave();
  leaveMeeting();
}

function enrol(newcomer: NewPerson, clip: Clip): void {
  watch(clip, (enrolment) => enrolment.start(newcomer, clip));
}

/** Into a meeting in which `somebody` moves by the keypoints in `file`. */
async function move(somebody: Somebody, file: File): Promise<void> {
  const meeting = await meetMoving(api, somebody, file, new AbortController().signal);
  setMeeting(meeting.id);
  come(meeting, GUEST);
}

/** Show the progress of an enrolment that `begin` sets going. */
function watch(clip: Clip | null, begin: (enrolment: Enrolment) => Promise<void>): void {
  // the server needs its strength for the new person, not for a picture that nobody sees
  leaveMeeting();
  const enrolment = new Enrolment(api, (state) => view.show(state), (mark) =>
    writeStored(BOOKMARK_KEY, mark),
  );
  const view = progressView(api, enrolment, clip, {
    onMeet: (modelId) => {
      enrolment.leave(); // the server goes on; the meeting is told of better likenesses
      void meet(modelId, enrolment.state.name);
    },
    onAgain: () => {
      enrolment.leave();
      writeStored(BOOKMARK_KEY, null);
      void start();
    },
  });
  view.show(enrolment.state);
  show(view);
  underWay = view;
  void begin(enrolment);
}

/** Into the meeting that is on, with the new model; else into one of its own. */
async function meet(modelId: string, name: string): Promise<void> {
  try {
    const meeting = (await addToMeeting(modelId)) ?? (await api.createMeeting(`${name}’s meeting`, [modelId]));
    writeStored(BOOKMARK_KEY, null);
    setMeeting(meeting.id);
    come(meeting, name);
  } catch (error) {
    showProblem(asProblem(error), () => void meet(modelId, name));
  }
}

async function addToMeeting(modelId: string): Promise<Meeting | null> {
  try {
    const meeting = await meetingToJoin();
    if (!meeting) return null;
    if (!meeting.performers.some((performer) => performer.model_id === modelId)) {
      await api.addPerformer(meeting.id, modelId);
    }
    return await api.meeting(meeting.id);
  } catch (error) {
    // a meeting that is over, full or closed to us is no reason not to meet
    if (error instanceof Problem && [403, 404, 409].includes(error.status)) return null;
    throw error;
  }
}

function leaveMeeting(): void {
  live?.close();
  attendance?.close();
  live = attendance = null;
}

function show(view: View): void {
  shown?.close();
  shown = view;
  underWay = null;
  const onStage = view.element.classList.contains("stage");
  page.replaceChildren(...(onStage ? [] : [header(home)]), view.element);
  scrollTo(0, 0);
  // whoever uses a keyboard or a screen reader goes on from the top of the new screen
  const first = onStage ? view.element : view.element.querySelector<HTMLElement>("h1[tabindex]");
  first?.focus({ preventScroll: true });
}

function home(): void {
  if (underWay?.busy()) return;
  writeStored(BOOKMARK_KEY, null);
  void start();
}

function showProblem(problem: Problem, again: () => void = () => void start()): void {
  const element = h(
    "main",
    { className: "trouble" },
    notice(
      problem,
      button("Try again", again, { look: "primary" }),
      query.has("meeting") && button("Go to the start", () => (setMeeting(null), void start())),
    ),
  );
  show({ element, close: nothing });
}

/** Keep the address telling which meeting this is, so that a reload leads back to it. */
function setMeeting(id: string | null): void {
  if (id === null) query.delete("meeting");
  else query.set("meeting", id);
  history.replaceState(null, "", query.size ? `/?${query.toString()}` : "/");
}

/** An invitation brings its token after the #, which browsers never send anywhere. */
function takeTokenFromAddress(): boolean {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!token) return false;
  sessionStorage.setItem(TOKEN_KEY, token);
  history.replaceState(null, "", location.pathname + location.search);
  return true;
}

function readStored<T>(key: string): T | null {
  const text = sessionStorage.getItem(key);
  return text === null ? null : (JSON.parse(text) as T);
}

function writeStored(key: string, value: unknown): void {
  if (value === null) sessionStorage.removeItem(key);
  else sessionStorage.setItem(key, JSON.stringify(value));
}

function nothing(): void {
  // some screens have nothing to end
}
