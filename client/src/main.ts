/** The page: which screen is shown, and what leads from one to the next. */

import "./style/tokens.css";
import "./style/base.css";
import "./style/start.css";
import "./style/progress.css";
import "./style/stage.css";
import "./style/self.css";
import { Api, type TokenStore } from "./api";
import { Enrolment, type Bookmark, type Clip } from "./enrol";
import { everybody, meetMoving, type Somebody } from "./keypoints";
import { LiveView } from "./live";
import { Problem, asProblem } from "./problem";
import type { Meeting } from "./types";
import { h, prefersStillness } from "./views/dom";
import { progressView, type ProgressView } from "./views/progress";
import { button, header, notice, type View } from "./views/shell";
import { stageView } from "./views/stage";
import { startView } from "./views/start";

const TOKEN_KEY = "metanerf.token";
const BOOKMARK_KEY = "metanerf.enrolment";
const GUEST = "Guest";

const tokens: TokenStore = {
  get: () => sessionStorage.getItem(TOKEN_KEY),
  set: (token) =>
    token === null ? sessionStorage.removeItem(TOKEN_KEY) : sessionStorage.setItem(TOKEN_KEY, token),
};
const query = new URLSearchParams(location.search);
const api = new Api(tokens);
const page = document.getElementById("page") as HTMLElement;

let shown: View | null = null;
let live: LiveView | null = null;
let underWay: ProgressView | null = null;

takeTokenFromAddress();
addEventListener("hashchange", () => takeTokenFromAddress() && location.reload());
const bookmark = readBookmark();
if (bookmark) watch(null, (enrolment) => enrolment.revisit(bookmark));
else void start();

/** The first screen, with a look into the meeting if there is one. */
async function start(): Promise<void> {
  leaveMeeting();
  show({ element: h("main", { className: "opening" }, h("span", { className: "spinner" })), close: nothing });
  try {
    const meeting = await meetingToJoin();
    if (meeting) {
      live = look(meeting, GUEST);
      live.swaying = true;
    }
    const hooks = { onJoin: join, onEnrol: enrol, everybody: () => everybody(api), onMove: move };
    show(startView(live, hooks));
    live?.start();
  } catch (error) {
    showProblem(asProblem(error));
  }
}

/** The meeting of the link, else the demo's. */
async function meetingToJoin(): Promise<Meeting | null> {
  const id = query.get("meeting") ?? (await api.demoMeeting());
  return id === null ? null : api.meeting(id);
}

function look(meeting: Meeting, displayName: string): LiveView {
  const size = Number(query.get("size"));
  const pinned = Number.isInteger(size) && size >= 128 && size <= 1024 ? size : null;
  return new LiveView(api, meeting, { displayName, pinned, inertia: !prefersStillness() });
}

/** From the first look into the meeting itself: same connection, larger picture. */
function join(): void {
  const seated = live;
  if (!seated) return;
  show(stageView(seated, { onLeave: () => void start(), onRetry: () => void rejoin(seated.meeting) }));
  seated.takeOver();
}

async function rejoin(meeting: Meeting, displayName = GUEST): Promise<void> {
  leaveMeeting();
  live = look(meeting, displayName);
  join();
  live.start();
}

function enrol(name: string, clip: Clip): void {
  watch(clip, (enrolment) => enrolment.start(name, clip));
}

/** Into a meeting in which `somebody` moves by the keypoints in `file`. */
async function move(somebody: Somebody, file: File): Promise<void> {
  const meeting = await meetMoving(api, somebody, file, new AbortController().signal);
  setMeeting(meeting.id);
  await rejoin(meeting);
}

/** Show the progress of an enrolment that `begin` sets going. */
function watch(clip: Clip | null, begin: (enrolment: Enrolment) => Promise<void>): void {
  // the server needs its strength for the new person, not for a picture that nobody sees
  leaveMeeting();
  const enrolment = new Enrolment(api, (state) => view.show(state), writeBookmark);
  const view = progressView(api, enrolment, clip, {
    onMeet: (modelId) => void meet(modelId, enrolment.state.name),
    onAgain: () => {
      enrolment.leave();
      writeBookmark(null);
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
    writeBookmark(null);
    setMeeting(meeting.id);
    await rejoin(meeting, name);
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
  live = null;
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
  writeBookmark(null);
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
  tokens.set(token);
  history.replaceState(null, "", location.pathname + location.search);
  return true;
}

function readBookmark(): Bookmark | null {
  const text = sessionStorage.getItem(BOOKMARK_KEY);
  return text === null ? null : (JSON.parse(text) as Bookmark);
}

function writeBookmark(mark: Bookmark | null): void {
  if (mark === null) sessionStorage.removeItem(BOOKMARK_KEY);
  else sessionStorage.setItem(BOOKMARK_KEY, JSON.stringify(mark));
}

function nothing(): void {
  // some screens have nothing to end
}
