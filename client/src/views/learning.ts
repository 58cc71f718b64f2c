/** Learning from live look: a switch and a lamp of its own, and what was kept, to be stored or dropped. */

import type { Api } from "../api/api";
import { Problem, asProblem } from "../api/problem";
import type { Job, KeptFrames } from "../api/types";
import type { LiveView } from "../drawing/live";
import { improvable } from "../enrolment/improve";
import { announce, h } from "./dom";
import { foldedWords } from "./foldedWords";
import { button } from "./shell";

const OFF = "Let your model learn sides of you that it has not seen. While live look is on, pictures of them wait on the server; you see them before you decide.";
const ON = "Pictures of new sides of you wait on the server. They are stored only if you say so at the end.";
const NOTHING = "No new side of you was seen well enough. Nothing was kept.";
const DROPPED = "Dropped. Nothing was kept.";
const LOST = "The connection was lost, and what waited was dropped.";
const LEARNING = "Your model learns from them, also when you leave.";
const LEARNT = "Your model has learnt new sides of you.";
const PENDING_KEY = "metanerf.learning";
const NOT_YOURS = new Problem("Your model cannot learn", "It must be a model of splats that you made, and be in this meeting.");

type Live = Pick<LiveView, "kept" | "meeting"> & { api: Pick<Api, "people" | "models" | "giveConsent" | "watchJob"> };

export interface LearningControl {
  element: HTMLElement;
  /** Ends it; resolves once what was kept is stored or dropped. Asked again, it drops what waits. */
  settle(): Promise<void>;
  /** The connection is gone, and what waited with it. */
  lost(): void;
  close(): void;
}

/** Off at first, always. */
export function learningControl(live: Live, performerId: string, memory: Storage = localStorage): LearningControl {
  const box = h("input", { type: "checkbox", id: "learning", testId: "learning", attributes: { role: "switch", "aria-describedby": "learning-words" } });
  const words = foldedWords("learning-words", "What is kept", OFF);
  const sheet = h("div", { className: "kept-sheet", testId: "kept-sheet", hidden: true });
  const element = h(
    "div",
    { className: "live-look learning" },
    h("div", { className: "switch-row" }, h("label", { attributes: { for: box.id } }, "Learn from it"), box),
    words.element,
    sheet,
  );
  const closing = new AbortController();
  let settled: (() => void) | null = null;

  const say = (text: string): void => {
    words.say(text);
    announce(text);
  };
  const lamp = (on: boolean): void => {
    box.checked = on;
    element.classList.toggle("on", on);
  };
  const fail = (error: unknown): void => {
    lamp(false);
    const { title, detail } = asProblem(error);
    say(`${title}. ${detail}`);
  };

  const begin = async (): Promise<void> => {
    try {
      await giveConsent(live, performerId);
      await live.kept.keep(true);
      lamp(true);
      say(ON);
    } catch (error) {
      fail(error);
    }
  };

  const hide = (): void => {
    sheet.hidden = true;
    sheet.replaceChildren();
    settled?.();
    settled = null;
  };
  const drop = async (): Promise<void> => {
    // what the server does not hear of, it drops when the connection ends
    await live.kept.drop().catch(() => undefined);
    say(DROPPED);
    hide();
  };
  const keep = async (): Promise<void> => {
    try {
      const job = await live.kept.learn();
      memory.setItem(PENDING_KEY, job.id);
      say(LEARNING);
      void follow(job.id);
    } catch (error) {
      fail(error);
    }
    hide();
  };

  const finish = async (): Promise<void> => {
    lamp(false);
    try {
      const kept = await live.kept.keep(false);
      if (kept.frames.length === 0) {
        await live.kept.drop();
        say(NOTHING);
        return;
      }
      say(`${counted(kept.frames.length)} of new sides: ${sidesOf(kept).join("; ")}. Keep them for your model?`);
      sheet.replaceChildren(
        h("div", { className: "kept-pictures" }, ...kept.frames.map(({ picture, sides }) => h("img", { src: picture, alt: `You, ${sides.join(" and ")}` }))),
        h("div", { className: "actions" }, button("Keep", () => void keep(), { look: "primary", testId: "kept-keep" }), button("Drop", () => void drop(), { testId: "kept-drop" })),
      );
      sheet.hidden = false;
      await new Promise<void>((resolve) => (settled = resolve));
    } catch (error) {
      fail(error);
    }
  };

  const follow = async (jobId: string): Promise<void> => {
    try {
      const job = await live.api.watchJob(jobId, () => undefined, closing.signal);
      memory.removeItem(PENDING_KEY);
      say(outcome(job));
    } catch {
      // who has left reads of it the next time
    }
  };

  box.addEventListener("change", () => void (box.checked ? begin() : finish()));
  const pending = memory.getItem(PENDING_KEY);
  if (pending !== null) void follow(pending);
  return {
    element,
    settle: async () => {
      if (!sheet.hidden) await drop();
      else if (box.checked) await finish();
    },
    lost: () => {
      if (!box.checked && sheet.hidden) return;
      lamp(false);
      say(LOST);
      hide();
    },
    close: () => {
      closing.abort();
      hide();
    },
  };
}

/** Have the performer's person consent to learning, beside what they consent to. */
async function giveConsent({ api, meeting }: Pick<Live, "api" | "meeting">, performerId: string): Promise<void> {
  const mine = (await improvable(api as Api, meeting.performers)).find((one) => one.performerId === performerId);
  const person = (await api.people()).find(({ id }) => id === mine?.personId);
  if (!person) throw NOT_YOURS;
  const { purposes, until, state } = person.consent;
  if (state === "given" && purposes.includes("learning")) return;
  await api.giveConsent(person.id, { purposes: [...purposes, "learning"], until });
}

function outcome({ state, error }: Job): string {
  if (state === "succeeded") return LEARNT;
  return `Your model stays as it was. ${error?.detail ?? "The training was stopped."}`;
}

function sidesOf({ frames }: KeptFrames): string[] {
  return [...new Set(frames.flatMap(({ sides }) => sides))];
}

function counted(pictures: number): string {
  return pictures === 1 ? "One picture" : `${pictures} pictures`;
}
