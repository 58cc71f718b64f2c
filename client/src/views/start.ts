/** The first screen: the meeting that is on, and the way to bring oneself in. */

import type { Api } from "../api/api";
import type { Sealing } from "../sealing/sealing";
import type { LiveView } from "../drawing/live";
import { deviceCheck } from "./deviceCheck";
import { privacyPanel } from "./privacy";
import { enrolForm, type EnrolHooks, type FilledForm } from "./enrolForm";
import { h } from "./dom";
import type { Meeting } from "../api/types";
import { mark, turningFigure } from "./icons";
import { keyProblem } from "./sealedNote";
import { sealedForm, type SealedFormHooks } from "./sealedForm";
import { button, type View } from "./shell";
import { waitingNote } from "./waitingNote";

interface StartHooks extends EnrolHooks, SealedFormHooks {
  /** Come in by this name. */
  onJoin(name: string): void;
  /** The name of last time. */
  name: string;
  /** Of the meeting, if it is sealed. */
  sealing: Sealing | null;
  /** As the form was sent that is to be mended. */
  filled: FilledForm | null;
}

const LONGEST_NAME = 60;

/** `live` is a first look into `meeting`; null where the host lets people in one by one, or the meeting is sealed. */
export function startView(api: Api, meeting: Meeting | null, live: LiveView | null, hooks: StartHooks): View {
  const form = enrolForm(hooks, hooks.filled);
  const check = deviceCheck(api);
  const privacy = privacyPanel(api, () => undefined);
  const element = h(
    "main",
    { className: "start" },
    meeting ? meetingHero(meeting, live, check.element, hooks) : plainHero(),
    h(
      "section",
      { className: "enrol", id: "bring", attributes: { "aria-labelledby": "bring-title" } },
      h(
        "div",
        { className: "enrol-text" },
        h("h2", { id: "bring-title" }, meeting ? "Create your model" : "Start with your model"),
        h(
          "p",
          { className: "lead" },
          "One short clip is enough for a 3D model of you. “Camera” guides you through it and checks each step; a clip of the same steps does as well.",
        ),
        turningFigure(),
        h(
          "ul",
          { className: "tips" },
          h("li", {}, "Your face close to the camera for three seconds, then both profiles"),
          h("li", {}, "From farther away: arms out a little, and once around if there is room"),
          h("li", {}, "Both hands, palms to the camera"),
          h("li", {}, "10 to 30 seconds, camera held still, even light, nobody else close to you"),
        ),
      ),
      form.element,
    ),
    sealedForm(hooks),
    h("footer", { className: "start-footer" }, privacy.element),
  );
  void privacy.load();
  return { element, close: () => (form.close(), check.close()) };
}

function meetingHero(meeting: Meeting, live: LiveView | null, check: HTMLElement, hooks: StartHooks): HTMLElement {
  return h(
    "section",
    { className: "hero", attributes: { "aria-labelledby": "hero-title" } },
    h(
      "div",
      { className: "hero-text" },
      h("h1", { id: "hero-title" }, "A meeting you can walk around in"),
      h(
        "p",
        { className: "lead" },
        "Everybody appears life-size, not in a video tile. Move around the room and look from wherever you like.",
      ),
      joinForm(meeting, hooks),
      check,
      meeting.recording === true && h("p", { className: "small", testId: "being-recorded" }, "This meeting is being recorded. You will be asked for consent after you join; nothing of yours is recorded before that."),
      h(
        "p",
        { className: "small" },
        h("a", { href: "#bring", onclick: scrollToForm }, "Create your model"),
        " · ",
        h("a", { href: "/?recordings" }, "Recorded meetings"),
      ),
    ),
    live ? livePreview(live) : closedNotice(meeting, hooks.sealing),
  );
}

function joinForm(meeting: Meeting, hooks: StartHooks): HTMLElement {
  const name = h("input", {
    className: "field",
    id: "join-name",
    value: hooks.name,
    maxLength: LONGEST_NAME,
    placeholder: "Guest",
    autocomplete: "name",
    testId: "join-name",
  });
  const form = h(
    "form",
    { className: "join-form" },
    h("label", { className: "label", attributes: { for: name.id } }, "Your name"),
    h(
      "div",
      { className: "actions" },
      name,
      button(meeting.lobby ? "Ask to join" : "Join the meeting", () => undefined, {
        look: "primary",
        large: true,
        icon: "arrow",
        submit: true,
        testId: "start-join",
      }),
    ),
  );
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    hooks.onJoin(name.value.trim());
  });
  return form;
}

const ADMITS = "The host admits participants one at a time.";
const SEALED = "This meeting is sealed: only people with the whole link see each other move.";

/** Where the host lets people in, or only pages that are in can draw it, there is nothing to see before. */
function closedNotice(meeting: Meeting, sealing: Sealing | null): HTMLElement {
  const why = [meeting.lobby && ADMITS, sealing && (keyProblem(sealing) ?? SEALED)];
  const words = h("p", {}, h("strong", {}, meeting.name), ...why.flatMap((one) => (one ? [h("br"), one] : [])));
  return h("div", { className: "live-preview lobby-only" }, mark(), words);
}

function livePreview(live: LiveView): HTMLElement {
  const who = h("p", { className: "live-preview-names" });
  const name = (): void => {
    const names = live.meeting.performers.map((performer) => performer.name);
    who.textContent = names.length ? `In the meeting: ${names.join(", ")}` : "Nobody is in the meeting yet";
  };
  name();
  live.onPerformers = name;
  const middle = h("div", { className: "live-preview-centre" });
  const window_ = h("div", { className: "live-preview" }, live.video, middle, who);
  live.onState = (state) => {
    window_.classList.toggle("waiting", state.kind !== "live");
    const waits = state.kind !== "live" && state.kind !== "refused";
    middle.replaceChildren(...(waits ? [waitingNote(state, false)] : []));
  };
  live.onState(live.state);
  return window_;
}

function plainHero(): HTMLElement {
  return h(
    "section",
    { className: "hero no-meeting" },
    h(
      "div",
      { className: "hero-text" },
      h("h1", {}, "A meeting you can walk around in"),
      h(
        "p",
        { className: "lead" },
        "Everybody appears life-size, not in a video tile. Record yourself once, then invite others with a link.",
      ),
    ),
  );
}

/** Not by the address: what follows # there is kept for invitations. */
function scrollToForm(event: Event): void {
  event.preventDefault();
  document.getElementById("bring")?.scrollIntoView({ behavior: "smooth" });
  document.querySelector<HTMLElement>("#bring input")?.focus({ preventScroll: true });
}
