/** The first screen: the meeting that is on, and the way to bring oneself in. */

import type { LiveView } from "../live";
import { enrolForm, type EnrolHooks } from "./enrolForm";
import { h } from "./dom";
import { turningFigure } from "./icons";
import { button, type View } from "./shell";
import { waitingNote } from "./waitingNote";

interface StartHooks extends EnrolHooks {
  onJoin(): void;
}

/** `live` is a first look into the meeting; null where there is none to join. */
export function startView(live: LiveView | null, hooks: StartHooks): View {
  const form = enrolForm(hooks);
  const element = h(
    "main",
    { className: "start" },
    live ? meetingHero(live, hooks.onJoin) : plainHero(),
    h(
      "section",
      { className: "enrol", id: "bring", attributes: { "aria-labelledby": "bring-title" } },
      h(
        "div",
        { className: "enrol-words" },
        h("h2", { id: "bring-title" }, live ? "Bring yourself in" : "Start with yourself"),
        h(
          "p",
          { className: "lead" },
          "One short clip is enough. Turn once, slowly, and you will stand in the meeting as you are.",
        ),
        turningFigure(),
        h(
          "ul",
          { className: "tips" },
          h("li", {}, "10 to 20 seconds, the camera standing still"),
          h("li", {}, "All of you in the picture, from head to feet"),
          h("li", {}, "Even light, and nobody close to you"),
        ),
      ),
      form.element,
    ),
  );
  return { element, close: () => form.close() };
}

function meetingHero(live: LiveView, onJoin: () => void): HTMLElement {
  const who = h("p", { className: "who" });
  const name = (): void => {
    const names = live.meeting.performers.map((performer) => performer.name);
    who.textContent = names.length ? `Now here: ${names.join(", ")}` : "Nobody is here yet";
  };
  name();
  live.onPerformers = name;
  const middle = h("div", { className: "window-middle" });
  const window_ = h("div", { className: "window" }, live.video, middle, who);
  live.onState = (state) => {
    window_.classList.toggle("waiting", state.kind !== "live");
    const waits = state.kind !== "live" && state.kind !== "refused";
    middle.replaceChildren(...(waits ? [waitingNote(state)] : []));
  };
  live.onState(live.state);
  return h(
    "section",
    { className: "hero", attributes: { "aria-labelledby": "hero-title" } },
    h(
      "div",
      { className: "hero-words" },
      h("h1", { id: "hero-title" }, "A meeting you can walk around in"),
      h(
        "p",
        { className: "lead" },
        "Everyone is there in full, not in a tile. Step closer, go round, look from wherever you like.",
      ),
      h(
        "div",
        { className: "ways" },
        button("Join the meeting", onJoin, {
          look: "primary",
          large: true,
          icon: "arrow",
          testId: "start-join",
        }),
        h("a", { className: "button quiet large", href: "#bring", onclick: toForm }, "Bring yourself in"),
      ),
    ),
    window_,
  );
}

function plainHero(): HTMLElement {
  return h(
    "section",
    { className: "hero alone" },
    h(
      "div",
      { className: "hero-words" },
      h("h1", {}, "A meeting you can walk around in"),
      h(
        "p",
        { className: "lead" },
        "Everyone is there in full, not in a tile. Film yourself once, then invite others with a link.",
      ),
    ),
  );
}

/** Not by the address: what follows # there is kept for invitations. */
function toForm(event: Event): void {
  event.preventDefault();
  document.getElementById("bring")?.scrollIntoView({ behavior: "smooth" });
  document.querySelector<HTMLElement>("#bring input")?.focus({ preventScroll: true });
}
