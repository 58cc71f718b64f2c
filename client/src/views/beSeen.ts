/** Being seen: the camera on or off, a small look at oneself, and in plain words what is seen. */

import type { Api } from "../api/api";
import { BeingSeen, type Tracking } from "../landmarks/beingSeen";
import { draw } from "../landmarks/skeleton";
import type { LiveView } from "../drawing/live";
import { Problem, asProblem } from "../api/problem";
import type { Performer } from "../api/types";
import { announce, h } from "./dom";
import { button, notice, type View } from "./shell";

const WORDS: Record<Tracking, string> = {
  starting: "Getting ready…",
  looking: "Nobody in sight: step back until your shoulders show",
  waiting: "Connecting to the meeting…",
  seen: "You move in the meeting",
};
const NOBODY = new Problem(
  "You have no body here yet",
  "Film yourself once on the first page; then come back and be seen.",
);

/** A button that switches the camera on and off, and a panel for what it shows. */
export function beSeenView(live: LiveView): View & { toggle: HTMLButtonElement; camera(): MediaStream | null } {
  const toggle = button("Be seen", () => void (element.hidden ? begin() : end()), {
    look: "glass",
    icon: "camera",
    testId: "be-seen",
  });
  toggle.title = "Move in the meeting as you move in front of your camera";
  const element = h("section", {
    className: "self glass",
    hidden: true,
    testId: "self",
    attributes: { "aria-label": "You" },
  });
  let seeing: BeingSeen | null = null;
  let asked = 0;

  const show = (on: boolean, ...children: Node[]): void => {
    toggle.setAttribute("aria-pressed", String(on));
    element.hidden = !on;
    element.replaceChildren(...children);
  };

  const end = (): void => {
    asked += 1;
    seeing?.close();
    seeing = null;
    show(false);
  };

  const complain = (problem: Problem): void => {
    end();
    show(true, notice(problem, button("Close", end)));
  };

  const begin = async (): Promise<void> => {
    const now = ++asked;
    show(true, words(WORDS.starting));
    try {
      const mine = await own(live.api, live.meeting.performers);
      if (now !== asked) return;
      if (mine.length === 0) throw NOBODY;
      if (mine.length === 1) be(mine[0] as Performer);
      else show(true, words("Who are you?"), ...mine.map((one) => button(one.name, () => be(one))));
    } catch (error) {
      if (now === asked) complain(asProblem(error));
    }
  };

  const be = ({ id, name }: Performer): void => {
    const told = words(WORDS.starting);
    const canvas = h("canvas", { attributes: { "aria-hidden": "true" } });
    const line = h("p", { className: "self-note" }, `As ${name}. Only your movements leave this device.`);
    seeing = new BeingSeen(() => live.drive(id), {
      onTracking: (tracking) => {
        element.dataset["tracking"] = tracking;
        told.textContent = WORDS[tracking];
        announce(WORDS[tracking]);
      },
      onLandmarks: (seen) => draw(canvas, seen),
      onProblem: complain,
    });
    show(true, h("div", { className: "self-picture" }, seeing.video, canvas), told, line);
    void seeing.start();
  };

  toggle.setAttribute("aria-pressed", "false");
  return { element, toggle, close: end, camera: () => seeing?.camera ?? null };
}

/** Performers of our own people; none for who was only invited to look. */
async function own(api: Api, performers: readonly Performer[]): Promise<Performer[]> {
  try {
    const models = new Set((await api.models()).map(({ id }) => id));
    return performers.filter(({ model_id }) => models.has(model_id));
  } catch (error) {
    if (error instanceof Problem && error.status === 403) return [];
    throw error;
  }
}

function words(text: string): HTMLElement {
  return h("p", { className: "self-words", testId: "self-words" }, text);
}
