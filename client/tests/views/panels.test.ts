// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Api } from "../../src/api/api";
import { Problem } from "../../src/api/problem";
import type { Consent, Person, Said } from "../../src/api/types";
import { chatPanel } from "../../src/views/chatPanel";
import { goodbyeView, lobbyView } from "../../src/views/lobby";
import { peoplePanel } from "../../src/views/peoplePanel";
import { privacyPanel } from "../../src/views/privacy";
import { handButton, reactionButton } from "../../src/views/reactions";
import { recordingControls } from "../../src/views/recordingControls";
import { sidePanel, type PanelName, type PanelPage } from "../../src/views/sidePanel";
import { fakeFetch, json, member, tokenStore } from "../fakes";
import { BO, HOST, find, inside, press } from "./inside";
import { eventually } from "../waiting";

const said = (number: number, from: string, text: string): Said => ({
  type: "said",
  number,
  participant_id: from,
  name: from === "me" ? "Ada" : "Bo",
  text,
  at: "2026-01-01T10:00:00Z",
});

const named = (within: Element, label: string): HTMLButtonElement => {
  const found = within.querySelector<HTMLButtonElement>(`button[aria-label="${label}"]`);
  if (!found) throw new Error(`no button “${label}”`);
  return found;
};

beforeEach(() => {
  document.body.innerHTML = '<div id="announcer"></div>';
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the chat", () => {
  function chat() {
    const there = inside();
    const panel = chatPanel(there.session);
    document.body.append(panel.element);
    there.session.subscribe(panel.update);
    const field = find<HTMLTextAreaElement>(panel.element, "chat-text");
    const lines = (): (string | null)[] => [...panel.element.querySelectorAll(".message-text")].map(({ textContent }) => textContent);
    const enter = (init: KeyboardEventInit = {}): void =>
      void field.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", cancelable: true, ...init }));
    return { ...there, ...panel, field, lines, enter };
  }

  it("shows each message once, with its author named once in a row", () => {
    const { element, hear, lines, roster } = chat();
    expect(element.textContent).toContain("Nobody has written yet.");
    for (const message of [said(1, "b", "Hello"), said(2, "b", "<i>Ada</i>"), said(3, "me", "Hi")]) hear(message);
    roster({});
    expect(lines()).toEqual(["Hello", "<i>Ada</i>", "Hi"]);
    const authors = [...element.querySelectorAll(".message-author strong")].map(({ textContent }) => textContent);
    expect(authors).toEqual(["Bo", "You"]);
    expect(element.querySelector("i")).toBeNull();
    expect(element.querySelector<HTMLElement>("p.secondary")?.hidden).toBe(true);
  });

  it("sends with Enter, but for Shift, an unfinished word and nothing written", () => {
    const { field, enter, sent } = chat();
    enter();
    field.value = "  Hello ";
    enter({ shiftKey: true });
    enter({ isComposing: true });
    expect(sent).toEqual([]);
    enter();
    expect(sent).toEqual([{ type: "say", text: "Hello" }]);
    expect(field.value).toBe("");
  });

  it("keeps what could not be sent, and says so", () => {
    const { element, session, field, enter } = chat();
    vi.spyOn(session, "send").mockReturnValue(false);
    field.value = "Hello";
    enter();
    expect(field.value).toBe("Hello");
    expect(element.querySelector("[role=status]")?.textContent).toContain("Not sent");
  });

  it("is read only for viewers", () => {
    const { field, roster } = chat();
    roster({ members: [member({ id: "me", role: "viewer" })] });
    expect([field.disabled, field.placeholder]).toEqual([true, "Viewers cannot write. Raise your hand to speak."]);
    roster({ members: [member({ id: "me" })] });
    expect(field.disabled).toBe(false);
  });
});

describe("the people", () => {
  function people(answer: Parameters<typeof inside>[0] = undefined) {
    const there = inside(answer);
    const panel = peoplePanel(there.session);
    document.body.append(panel.element);
    there.session.subscribe(panel.update);
    return { ...there, ...panel };
  }

  it("are told apart: oneself, the host, viewers, and who lost the connection", () => {
    const { element, roster } = people();
    roster({ members: [HOST, member({ id: "v", name: "Vi", role: "viewer" }), member({ id: "x", name: "Xu", present: false, connection: "poor" })] });
    const rows = [...element.querySelectorAll("[data-testid=members] li")];
    expect(rows.map((row) => row.querySelector(".member-text")?.textContent)).toEqual(["me (you)Host", "ViViewer", "XuConnection lost"]);
    expect(rows.map((row) => row.querySelector<HTMLElement>("[data-testid=network]")?.hidden)).toEqual([true, true, true]);
    roster({ members: [HOST, member({ id: "x", name: "Xu", connection: "poor" })] });
    expect(element.querySelector<HTMLElement>("li:nth-child(2) [data-testid=network]")?.title).toBe("Poor connection");
  });

  it("who wait are let in or denied by the host", () => {
    const { element, roster, sent } = people();
    expect(find<HTMLElement>(element, "waiting-people").hidden).toBe(true);
    roster({ members: [HOST, member({ id: "w", name: "Wim", admission: "waiting" })] });
    named(element, "Let in: Wim").click();
    named(element, "Deny: Wim").click();
    expect(sent).toEqual([{ type: "admit", participant_id: "w" }, { type: "deny", participant_id: "w" }]);
  });

  it("can be muted, made host, made viewer or removed by the host", () => {
    const { element, roster, sent } = people();
    roster({ members: [HOST, { ...BO, microphone: true }] });
    named(element, "More about Bo").click();
    for (const label of ["Mute: Bo", "Make host: Bo", "Make viewer: Bo", "Remove: Bo"]) named(element, label).click();
    expect(sent).toEqual([
      { type: "mute", participant_id: "b" },
      { type: "role", participant_id: "b", role: "host" },
      { type: "role", participant_id: "b", role: "viewer" },
      { type: "remove", participant_id: "b" },
    ]);
    roster({ members: [HOST, { ...BO, role: "viewer" }] });
    named(element, "Make speaker: Bo").click();
    expect(sent.at(-1)).toEqual({ type: "role", participant_id: "b", role: "speaker" });
  });

  it("are nobody's to manage but the host's", () => {
    const { element, roster } = people();
    roster({ members: [member({ id: "me" }), BO] });
    expect(named(element, "More about Bo").hidden).toBe(true);
    expect(find<HTMLElement>(element, "lobby").closest<HTMLElement>("div")?.hidden).toBe(true);
    expect(find<HTMLElement>(element, "end").closest<HTMLElement>(".panel-footer")?.hidden).toBe(true);
  });

  it("are sent home only once the host is sure", () => {
    const { element, sent } = people();
    press(element, "end");
    expect(document.activeElement).toBe(find(element, "end-sure"));
    [...element.querySelectorAll("button")].find(({ textContent }) => textContent === "Cancel")?.click();
    expect([sent, find<HTMLElement>(element, "end").hidden]).toEqual([[], false]);
    press(element, "end");
    press(element, "end-sure");
    expect(sent).toEqual([{ type: "end" }]);
  });

  it("get a new invitation once the host has read what it does to the old one", async () => {
    const { element, session, calls } = people(({ path }) => (path.endsWith("/invitation") ? json({ join_url: "/?meeting=m#token=new" }) : json({})));
    press(element, "renew-invitation");
    expect(document.activeElement?.textContent).toBe("Keep the old link");
    expect(element.textContent).toContain("The link that was sent so far stops working");
    expect(element.textContent).toContain("Whoever is in the meeting stays in it.");
    expect(calls.some(({ path }) => path.endsWith("/invitation"))).toBe(false);
    press(element, "renew-invitation-sure");
    await eventually(() => expect(find(element, "invitation-told").textContent).toContain("The old link no longer works."));
    expect(calls.at(-1)).toMatchObject({ method: "POST", path: "/v1/meetings/m/invitation", token: "Bearer seat" });
    expect(session.meeting.join_url).toBe("/?meeting=m#token=new");
  });

  it("keep the old invitation where the server refuses, which is said", async () => {
    const { element } = people(({ path }) => (path.endsWith("/invitation") ? json({ title: "Not host", detail: "ask the host" }, 403) : json({})));
    press(element, "renew-invitation");
    press(element, "renew-invitation-sure");
    await eventually(() => expect(find(element, "invitation-told").textContent).toBe("Not host. Ask the host."));
  });
});

describe("hands and reactions", () => {
  it("raises the hand, and lowers it again", () => {
    const { session, sent, roster } = inside();
    const hand = handButton(session);
    session.subscribe(hand.update);
    hand.element.click();
    roster({ members: [{ ...HOST, hand_at: "2026-01-01T00:00:00Z" }] });
    expect(hand.element.getAttribute("aria-pressed")).toBe("true");
    hand.element.click();
    expect(sent).toEqual([{ type: "hand", raised: true }, { type: "hand", raised: false }]);
  });

  it("sends a reaction and folds the choices, as Escape does", () => {
    const { session, sent } = inside();
    const { element } = reactionButton(session);
    document.body.append(element);
    const choices = element.querySelector<HTMLElement>("[role=group]");
    press(element, "react");
    expect(choices?.hidden).toBe(false);
    press(element, "react-heart");
    expect([sent, choices?.hidden]).toEqual([[{ type: "react", reaction: "heart" }], true]);
    press(element, "react");
    element.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape" }));
    expect(choices?.hidden).toBe(true);
    expect(document.activeElement).toBe(find(element, "react"));
  });
});

describe("recording a meeting", () => {
  function controls() {
    const there = inside();
    const made = recordingControls(there.session);
    there.session.subscribe(made.update);
    const words = (): string => find(made.note, "recording").textContent?.trim() ?? "";
    return { ...there, ...made, words };
  }

  it("is asked for and ended by the host", () => {
    const { element, sent, roster } = controls();
    element.click();
    roster({ recording: { id: "r", running: true, agreed: ["me", "b"] } });
    expect(element.getAttribute("aria-pressed")).toBe("true");
    element.click();
    expect(sent).toEqual([{ type: "record", on: true }, { type: "record", on: false }]);
    roster({ members: [member({ id: "me" })] });
    expect(element.hidden).toBe(true);
  });

  it("asks each for consent, and says when it runs and where it can be watched", () => {
    const { note, words, sent, roster } = controls();
    expect(note.hidden).toBe(true);
    roster({ recording: { id: "r", running: false, agreed: [] } });
    expect(words()).toContain("asks to record");
    press(note, "recording-agree");
    expect(sent).toEqual([{ type: "agree", on: true }]);
    roster({ recording: { id: "r", running: false, agreed: ["me"] } });
    expect([words(), find<HTMLElement>(note, "recording-agree").hidden]).toEqual(["Recording starts once everybody agrees", true]);
    roster({ recording: { id: "r", running: true, agreed: ["me", "b"] } });
    expect([words(), find(note, "recording-refuse").textContent]).toEqual(["Recording", "Stop recording"]);
    press(note, "recording-refuse");
    expect(sent.at(-1)).toEqual({ type: "agree", on: false });
    roster({ recording: null });
    expect(note.querySelector("a")?.getAttribute("href")).toBe("/?recording=r");
  });

  it("is no more to be seen where one had no part in it", () => {
    const { note, roster } = controls();
    roster({ recording: { id: "r", running: false, agreed: [] } });
    roster({ recording: null });
    expect(note.hidden).toBe(true);
  });
});

describe("the side panel", () => {
  it("shows one page at a time, and gives the focus back to its button", () => {
    const onChange = vi.fn();
    const opened = vi.fn();
    const page = (title: string, more: Partial<PanelPage> = {}): PanelPage => ({
      title,
      toggle: document.body.appendChild(document.createElement("button")),
      element: document.createElement("div"),
      update: () => undefined,
      ...more,
    });
    const pages: Record<PanelName, PanelPage> = { people: page("People"), chat: page("Chat"), more: page("This meeting", { opened }) };
    const panel = sidePanel(pages, onChange);
    document.body.append(panel.element);
    pages.people.toggle.click();
    expect([panel.open, panel.element.hidden, panel.element.querySelector("h2")?.textContent]).toEqual(["people", false, "People"]);
    pages.more.toggle.click();
    expect(opened).toHaveBeenCalledTimes(1);
    expect([pages.people.element.hidden, pages.more.element.hidden]).toEqual([true, false]);
    expect(pages.people.toggle.getAttribute("aria-expanded")).toBe("false");
    panel.element.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape" }));
    expect([panel.open, panel.element.hidden]).toEqual([null, true]);
    expect(document.activeElement).toBe(pages.more.toggle);
    expect(onChange).toHaveBeenCalledTimes(3);
  });
});

describe("the lobby", () => {
  it("says that one waits, and that the connection is lost meanwhile", () => {
    const { session, state } = inside();
    const { element, close } = lobbyView(session, () => undefined);
    expect(element.textContent).toContain("The host of “Monday” knows that you are waiting.");
    state({ kind: "lost" });
    expect(element.textContent).toContain("Connection lost. Reconnecting");
    state({ kind: "open" });
    expect(element.textContent).toContain("knows that you are waiting");
    state({ kind: "lost", waitS: 20 });
    expect(element.textContent).toContain("Waiting for the server");
    expect(element.textContent).toContain("Too many requests. Trying again in 20 s.");
    close();
  });

  it("is left by its button", () => {
    const onLeave = vi.fn();
    press(lobbyView(inside().session, onLeave).element, "lobby-leave");
    expect(onLeave).toHaveBeenCalledTimes(1);
  });
});

describe("the goodbye", () => {
  const hooks = { onStart: vi.fn(), onContinueHere: vi.fn() };

  it("says why one is out, in the server's words where it has some", () => {
    expect(goodbyeView("denied", null, hooks).element.textContent).toContain("The host of this meeting did not let you in.");
    expect(goodbyeView("ended", null, hooks).element.textContent).toContain("The meeting is over");
    const full = new Problem("The meeting is full", "Twelve are in it.", 409);
    expect(goodbyeView("refused", full, hooks).element.textContent).toContain("The meeting is full");
  });

  it("offers to continue here only where another tab took over", () => {
    const buttons = (reason: "replaced" | "removed"): string[] =>
      [...goodbyeView(reason, null, hooks).element.querySelectorAll("button")].map(({ textContent }) => textContent ?? "");
    expect(buttons("removed")).toEqual(["Back to the start"]);
    expect(buttons("replaced")).toEqual(["Continue here", "Back to the start"]);
  });
});

describe("privacy", () => {
  const GIVEN: Consent = { purposes: ["meetings", "recordings"], until: null, state: "given", revoked_at: null };
  const ADA = { id: "p", name: "Ada", mine: true, consent: GIVEN } as unknown as Person;

  async function panel(erase: () => Response = () => new Response(null, { status: 204 }), consent: Consent = GIVEN) {
    let listed: object[] = [{ ...ADA, consent }, { id: "lent", name: "Demo", mine: false }];
    const { request, calls } = fakeFetch(({ method, path }) => {
      if (method === "GET") return json({ items: listed });
      if (path.endsWith("/consent")) {
        return json(method === "PUT" ? { ...GIVEN, purposes: ["meetings"], until: "2030-01-02T00:00:00Z" } : { ...GIVEN, state: "revoked", revoked_at: "2026-01-01T12:00:00Z" });
      }
      listed = listed.slice(1);
      return erase();
    });
    const onErased = vi.fn();
    const made = privacyPanel(new Api(tokenStore("guest"), request), onErased);
    document.body.append(made.element);
    await made.load();
    return { ...made, calls, onErased };
  }

  it("erases one's own people, and only when one is sure", async () => {
    const { element, calls, onErased } = await panel();
    expect(element.querySelectorAll("[data-testid=erase]")).toHaveLength(1);
    press(element, "erase");
    expect(document.activeElement?.textContent).toBe("Keep");
    (document.activeElement as HTMLElement).click();
    expect(calls.filter(({ method }) => method === "DELETE")).toEqual([]);
    press(element, "erase");
    press(element, "erase-sure");
    await eventually(() => expect(onErased).toHaveBeenCalledTimes(1));
    expect(calls.find(({ method }) => method === "DELETE")?.path).toBe("/v1/people/p");
    await eventually(() => expect(element.querySelector("[data-testid=erase]")).toBeNull());
    expect(element.querySelector("[role=status]")?.textContent).toBe("Ada has been erased, with every clip, model and recording.");
  });

  it("says what one's model may be used for, and revokes that only when one is sure", async () => {
    const { element, calls } = await panel();
    const state = find(element, "consent-state");
    expect(state.textContent).toBe("Consent given for meetings, recordings; no end is set.");
    press(element, "consent-revoke");
    expect(document.activeElement?.textContent).toBe("Keep");
    expect(find(element, "consent").textContent).toContain("disappears at once from meetings");
    press(element, "consent-revoke-sure");
    await eventually(() => expect(state.textContent).toMatch(/^Consent revoked on .*2026: the model is shown nowhere\.$/));
    expect(calls.at(-1)).toMatchObject({ method: "DELETE", path: "/v1/people/p/consent" });
    expect(element.querySelector("[data-testid=consent-revoke]")).toBeNull();
    expect(find(element, "consent-change").textContent).toBe("Give consent again");
  });

  it("takes a consent that was changed, until the end of a day", async () => {
    const { element, calls } = await panel(undefined, { ...GIVEN, state: "ended", until: "2025-06-01T00:00:00Z" });
    expect(find(element, "consent-state").textContent).toMatch(/^Consent ended after .*: the model is shown nowhere\.$/);
    press(element, "consent-change");
    find<HTMLInputElement>(element, "consent-p-recordings").checked = false;
    find<HTMLInputElement>(element, "consent-p-until").value = "2030-01-01";
    find<HTMLElement>(element, "consent-save").closest("form")?.dispatchEvent(new Event("submit", { cancelable: true }));
    await eventually(() => expect(find(element, "consent-state").textContent).toMatch(/^Consent given for meetings; until .*2030\.$/));
    expect(calls.at(-1)).toMatchObject({ method: "PUT", path: "/v1/people/p/consent", body: JSON.stringify({ purposes: ["meetings"], until: new Date(2030, 0, 2).toISOString() }) });
  });

  it("says why somebody could not be erased", async () => {
    const { element, onErased } = await panel(() => json({ title: "Busy", detail: "a job runs" }, 409));
    press(element, "erase");
    press(element, "erase-sure");
    await eventually(() => expect(element.querySelector("[role=status]")?.textContent).toBe("Busy. A job runs."));
    expect(onErased).not.toHaveBeenCalled();
  });
});
