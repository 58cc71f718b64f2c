/** The page: which screen is shown, and what leads from one to the next. */

import "./style/tokens.css";
import "./style/base.css";
import "./style/start.css";
import "./style/guide.css";
import "./style/progress.css";
import "./style/viewport.css";
import "./style/replay.css";
import "./style/meeting.css";
import "./style/panel.css";
import "./style/more.css";
import "./style/devices.css";
import "./style/self.css";
import "./style/screens.css";
import "./style/sealed.css";
import { Api } from "./api/api";
import { SignIn } from "./api/signIn";
import { readStored, writeStored } from "./api/stored";
import { TOKEN_KEY, browserTokens as tokens } from "./api/tokenStore";
import { chosenDevices } from "./capture/devices";
import { Enrolment, browserUploads, type Bookmark, type Clip } from "./enrolment/enrol";
import { animatablePeople, createKeypointsMeeting, type AnimatablePerson } from "./enrolment/keypoints";
import { guideStore } from "./enrolment/recordedSteps";
import { LiveView } from "./drawing/live";
import { MeetingSession, type StoredSeat, type SeatStore } from "./meeting/session";
import { reloadForNewGateways } from "./meeting/newGateways";
import type { ControlState } from "./meeting/controlConnection";
import { localParticipant } from "./meeting/state";
import { MeetingKey } from "./sealing/meetingKey";
import { Sealing, canSeal } from "./sealing/sealing";
import { NO_GUESTS, Problem, asProblem } from "./api/problem";
import type { Meeting, NewPerson } from "./api/types";
import { accountControl, signInView } from "./views/account";
import { h, prefersReducedMotion } from "./views/dom";
import { goodbyeView, lobbyView } from "./views/lobby";
import { meetingTools } from "./views/meetingTools";
import { progressView, type ProgressView } from "./views/progress";
import { button, header, notice, type View } from "./views/shell";
import { meetingView } from "./views/meetingView";
import type { FilledForm } from "./views/enrolForm";
import { startView } from "./views/start";
import { enterVrButton } from "./xr/enterButton";

const BOOKMARK_KEY = "metanerf.enrolment";
const SEALED_KEY = "metanerf.key.";
const SEAT_KEY = "metanerf.seat";
const NAME_KEY = "metanerf.name";
const GUEST = "Guest";

const seatStore: SeatStore = {
  get: () => readStored<StoredSeat>(SEAT_KEY),
  set: (stored) => writeStored(SEAT_KEY, stored),
};
const query = new URLSearchParams(location.search);
const api = new Api(tokens);
const signIn = new SignIn(tokens);
const access = signIn.access();
const page = document.getElementById("page") as HTMLElement;

let shown: View | null = null;
let live: LiveView | null = null;
let session: MeetingSession | null = null;
let activeProgress: ProgressView | null = null;
let signInWord: string | null = null;

takeSecretsFromAddress();
addEventListener("hashchange", () => takeSecretsFromAddress() && location.reload());
reloadForNewGateways(() => location.reload());
void open();

async function open(): Promise<void> {
  const problem = signInWord === null ? null : await signIn.finish(signInWord);
  const bookmark = readStored<Bookmark>(BOOKMARK_KEY);
  if (problem) await showSignIn(problem);
  else if (query.has("recording")) await showRecording(query.get("recording") ?? "");
  else if (query.has("recordings")) await showRecordings();
  else if (bookmark) showEnrolment(null, (enrolment) => enrolment.continueFrom(bookmark));
  else await start();
}

/** The start screen, with a live preview of the meeting if there is one; with the form as it was `filled`. */
async function start(filled: FilledForm | null = null): Promise<void> {
  leaveMeeting();
  show({ element: h("main", { className: "loading" }, h("span", { className: "spinner" })), close: nothing });
  try {
    const meeting = await meetingToJoin();
    const stored = seatStore.get();
    // a reload keeps the seat
    if (meeting && stored?.meetingId === meeting.id) return joinMeeting(meeting, stored.name, stored);
    if (meeting) session = new MeetingSession(api, meeting, seatStore);
    const sealing = meeting && sealingOf(meeting);
    if (session && !meeting?.lobby && !sealing) {
      live = createLiveView(session);
      live.swaying = true;
    }
    const name = localStorage.getItem(NAME_KEY) ?? tokens.account() ?? "";
    const hooks = { name, sealing, filled, onJoin: join, onEnrol: enrol, listPeople: () => animatablePeople(api), onAnimate: animate, onSeal: openSealed };
    show(startView(api, meeting, live, hooks));
    live?.start();
  } catch (error) {
    showProblem(asProblem(error), () => void start(filled));
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

function createLiveView(current: MeetingSession): LiveView {
  const size = Number(query.get("size"));
  const pinned = Number.isInteger(size) && size >= 128 && size <= 1024 ? size : null;
  // once we have joined, the control connection alone says on which seat we are
  const seat = (stale: boolean): ReturnType<MeetingSession["getSeat"]> =>
    stale && current.joined ? current.heldSeat() : current.getSeat(stale);
  const sealing = sealingOf(current.meeting);
  const address = (lost: boolean): Promise<string> => current.addressOf(`/whep/${current.meeting.id}`, lost);
  return new LiveView(api, current.meeting, { seat, address, pinned, stamped: query.has("stamp"), inertia: !prefersReducedMotion(), sealing });
}

/** A link with a key means a sealed meeting, whatever the server says of it. */
function sealingOf(meeting: Meeting): Sealing | null {
  const told = sessionStorage.getItem(SEALED_KEY + meeting.id);
  return meeting.sealed || told !== null ? new Sealing(meeting, canSeal() ? MeetingKey.read(told) : null) : null;
}

/** Into a new meeting whose key this page draws. */
async function openSealed(person: AnimatablePerson | null): Promise<void> {
  const meeting = await api.createMeeting("Sealed meeting", person ? [person.modelId] : [], true);
  sessionStorage.setItem(SEALED_KEY + meeting.id, MeetingKey.random().text);
  setMeeting(meeting.id);
  joinMeeting(meeting, localStorage.getItem(NAME_KEY) || person?.name || GUEST);
}

/** From the preview into the meeting: same seat, same connection, larger picture. */
function join(name: string): void {
  if (name !== "") localStorage.setItem(NAME_KEY, name);
  if (!session) return;
  session.joinsUnmuted = chosenDevices().joinUnmuted;
  session.join(name || GUEST);
  followSession(session);
}

function joinMeeting(meeting: Meeting, name: string, stored: StoredSeat | null = null): void {
  leaveMeeting();
  session = new MeetingSession(api, meeting, seatStore);
  session.join(name, stored);
  followSession(session);
}

/** Show the screen of the session's state: lobby, meeting or goodbye. */
function followSession(current: MeetingSession): void {
  let screen: "start" | "lobby" | "meeting" = "start";
  const showScreen = (next: "lobby" | "meeting"): void => {
    if (screen === next) return;
    screen = next;
    if (next === "meeting") showMeeting(current);
    else showLobby(current);
  };
  // with the preview live there is no need to wait for the control connection
  if (live) showScreen("meeting");
  current.subscribe(() => {
    if (session !== current) return;
    if (current.connectionState.kind === "ended") showGoodbye(current, current.connectionState);
    else if (current.admitted) showScreen("meeting");
    else if (localParticipant(current.state)) showScreen("lobby");
    // without a seat there is no other screen yet that could say so
    else if (current.connectionState.kind === "lost" && current.connectionState.waitS !== undefined && screen === "start") showScreen("lobby");
  });
}

function showMeeting(current: MeetingSession): void {
  const view = live ?? createLiveView(current);
  const isNew = view !== live;
  live = view;
  const rejoin = (): void => (giveSeatBack(), joinMeeting(current.meeting, localStorage.getItem(NAME_KEY) || GUEST));
  const tools = meetingTools(api, current);
  const headset = enterVrButton(view, current, { microphone: tools.toggleMicrophone, leave: leaveToStart });
  show(meetingView(view, tools, headset, { onLeave: leaveToStart, onRetry: rejoin }));
  view.startInteractive();
  if (isNew) view.start();
  let wasOpen = true;
  let { home } = current;
  current.subscribe(() => {
    const isOpen = current.connectionState.kind === "open";
    const elsewhere = home !== null && home !== current.home;
    if (elsewhere || (isOpen && !wasOpen)) view.retryNow(elsewhere);
    [wasOpen, home] = [isOpen, current.home];
    if (!current.admitted) return;
    void view.showEnvironment(current.state.environment);
    if (current.state.performers) view.roster.showOnly(current.state.performers);
  });
}

function showLobby(current: MeetingSession): void {
  live?.close();
  live = null;
  show(lobbyView(current, leaveToStart));
}

function showGoodbye(current: MeetingSession, { reason, problem }: Extract<ControlState, { kind: "ended" }>): void {
  leaveMeeting();
  const stored = seatStore.get();
  const onHere = (): void => joinMeeting(current.meeting, stored?.name ?? GUEST, stored);
  const onBack = (): void => {
    seatStore.set(null);
    // a meeting that has ended cannot be rejoined
    if (reason === "ended") setMeeting(null);
    void start();
  };
  show(goodbyeView(reason, problem, { onStart: onBack, onContinueHere: onHere }));
}

function leaveToStart(): void {
  giveSeatBack();
  void start();
}

function giveSeatBack(): void {
  session?.leave();
  leaveMeeting();
}

function enrol(newcomer: NewPerson, clip: Clip): void {
  showEnrolment({ newcomer, clip }, (enrolment) => enrolment.start(newcomer, clip));
}

/** Into a meeting in which the model of `person` is animated by the keypoints in `file`. */
async function animate(person: AnimatablePerson, file: File): Promise<void> {
  const meeting = await createKeypointsMeeting(api, person, file, new AbortController().signal);
  setMeeting(meeting.id);
  joinMeeting(meeting, GUEST);
}

/** Show the progress of an enrolment that `begin` starts. */
function showEnrolment(filled: FilledForm | null, begin: (enrolment: Enrolment) => Promise<void>): void {
  // the server needs its strength for the new person, not for a picture that nobody sees
  leaveMeeting();
  const onBookmark = (mark: Bookmark | null): void => {
    writeStored(BOOKMARK_KEY, mark);
    // the clip has arrived: no copy of it stays in the browser
    if (mark) void guideStore.forget();
  };
  const enrolment = new Enrolment(api, (state) => view.show(state), onBookmark, browserUploads);
  const view = progressView(api, enrolment, filled?.clip ?? null, {
    onMeet: (modelId) => {
      enrolment.leave(); // the server goes on; the meeting is told of better models
      void meet(modelId, enrolment.state.name);
    },
    onAgain: () => {
      enrolment.leave();
      writeStored(BOOKMARK_KEY, null);
      void start(filled);
    },
  });
  view.show(enrolment.state);
  show(view);
  activeProgress = view;
  void begin(enrolment);
}

/** Into the meeting that is on, with the new model; else into one of its own. */
async function meet(modelId: string, name: string): Promise<void> {
  try {
    const meeting = (await addToMeeting(modelId, name)) ?? (await api.createMeeting(`${name}’s meeting`, [modelId]));
    writeStored(BOOKMARK_KEY, null);
    setMeeting(meeting.id);
    const stored = seatStore.get();
    joinMeeting(meeting, name, stored?.meetingId === meeting.id ? stored : null);
  } catch (error) {
    showProblem(asProblem(error), () => void meet(modelId, name));
  }
}

async function addToMeeting(modelId: string, name: string): Promise<Meeting | null> {
  try {
    const meeting = await meetingToJoin();
    if (!meeting) return null;
    if (!meeting.performers.some((performer) => performer.model_id === modelId)) {
      await bring(meeting, modelId, name);
    }
    return await api.meeting(meeting.id);
  } catch (error) {
    // a meeting that is over, full or closed to us is no reason not to meet
    if (error instanceof Problem && [403, 404, 409].includes(error.status)) return null;
    throw error;
  }
}

/** In somebody else's meeting only who sits in it may stand; who has to wait for that brings their model once they are in. */
async function bring(meeting: Meeting, modelId: string, name: string): Promise<void> {
  try {
    await api.addPerformer(meeting.id, modelId);
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 403) throw error;
    const seat = await api.join(meeting.id, name);
    seatStore.set({ meetingId: meeting.id, name, seat, lastRead: 0 });
    if (!meeting.lobby) await api.addPerformer(meeting.id, modelId);
  }
}

function leaveMeeting(): void {
  live?.close();
  session?.close();
  live = session = null;
}

function show(view: View): void {
  shown?.close();
  shown = view;
  activeProgress = null;
  const fullWindow = view.element.classList.contains("viewport");
  page.replaceChildren(...(fullWindow ? [] : [header(home, accountControl(access, tokens.account(), { onSignIn, onSignOut }))]), view.element);
  scrollTo(0, 0);
  // whoever uses a keyboard or a screen reader goes on from the top of the new screen
  const first = fullWindow ? view.element : view.element.querySelector<HTMLElement>("h1[tabindex]");
  first?.focus({ preventScroll: true });
}

function home(): void {
  if (activeProgress?.busy()) return;
  writeStored(BOOKMARK_KEY, null);
  void start();
}

function showProblem(problem: Problem, again: () => void = () => void start()): void {
  void (problem.needsAccount ? showSignIn(problem) : showNotice(problem, again));
}

/** The way in for whom `problem` keeps out, where the server has one. */
async function showSignIn(problem: Problem): Promise<void> {
  const { login, guests } = await access;
  if (!login) return showNotice(problem, () => void start());
  const onGuest = (): void => (tokens.signOut(), void start());
  show(signInView(problem === NO_GUESTS ? null : problem, onSignIn, guests ? onGuest : null));
}

function onSignIn(): void {
  location.assign(SignIn.address(location.pathname + location.search));
}

function onSignOut(): void {
  giveSeatBack();
  void guideStore.forget().finally(() => (tokens.signOut(), location.assign("/v1/logout")));
}

function showNotice(problem: Problem, again: () => void): void {
  const ways = [
    button("Try again", again, { look: "primary" }),
    query.has("meeting") && button("Go to the start", () => (setMeeting(null), void start())),
  ];
  show({ element: h("main", { className: "problem-screen" }, notice(problem, ...ways)), close: nothing });
}

/** Keep the address telling which meeting this is, so that a reload leads back to it. */
function setMeeting(id: string | null): void {
  if (id === null) query.delete("meeting");
  else query.set("meeting", id);
  history.replaceState(null, "", query.size ? `/?${query.toString()}` : "/");
}

/** An invitation brings its token, and a sealed meeting's key, after the #, which browsers never send anywhere. */
function takeSecretsFromAddress(): boolean {
  const secrets = new URLSearchParams(location.hash.slice(1));
  const [token, key] = [secrets.get("token"), secrets.get("key")];
  signInWord = secrets.get("login");
  if (token) sessionStorage.setItem(TOKEN_KEY, token);
  if (key) sessionStorage.setItem(SEALED_KEY + (query.get("meeting") ?? ""), key);
  if (!token && !key && signInWord === null) return false;
  history.replaceState(null, "", location.pathname + location.search);
  return true;
}

function nothing(): void {
  // some screens have nothing to end
}
