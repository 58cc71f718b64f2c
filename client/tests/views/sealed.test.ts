// @vitest-environment happy-dom
import { beforeEach, describe, expect, it, vi } from "vitest";
import { Problem } from "../../src/api/problem";
import type { AnimatablePerson } from "../../src/enrolment/keypoints";
import type { MeetingKey } from "../../src/sealing/meetingKey";
import { Sealing } from "../../src/sealing/sealing";
import { sealedForm } from "../../src/views/sealedForm";
import { sealedNote } from "../../src/views/sealedNote";
import { CASES, KEY } from "../sealing/cases";
import { find } from "./inside";

const settled = (): Promise<void> => new Promise((done) => setTimeout(done, 10));

beforeEach(() => {
  document.body.innerHTML = '<div id="announcer"></div>';
});

function note(id: string, key: MeetingKey | null) {
  const sealing = new Sealing({ id, performers: [] }, key);
  const made = sealedNote(sealing)!;
  document.body.append(made.element);
  return { ...made, motions: sealing.motions, details: made.element as HTMLDetailsElement, problem: find<HTMLElement>(made.element, "sealed-problem") };
}

describe("the note of a sealed meeting", () => {
  it("shows the code to compare, and what is sealed and what is not", async () => {
    const { element, details, problem } = note(CASES.meeting, KEY);
    await settled();
    expect(find(element, "sealed-code").textContent).toBe(CASES.code);
    expect([problem.hidden, details.open]).toEqual([true, false]);
    expect(element.textContent).toContain("Not sealed, so the server can read it: voices, shared screens, chat");
  });

  it("says at once that the link lacks the key", () => {
    const { element, details, problem } = note("m", null);
    expect([problem.hidden, details.open]).toEqual([false, true]);
    expect(problem.textContent).toContain("This link lacks the meeting’s key");
    expect(element.querySelector("summary")?.textContent).toBe("Sealed: key missing");
    expect(find(element, "sealed-code").parentElement?.hidden).toBe(true);
    expect(document.getElementById("announcer")?.textContent).toContain("This link lacks");
  });

  it("names whose motion does not open, until it does", () => {
    const { motions, details, problem } = note("m", KEY);
    motions.onUnreadable(["Ada", "Bo"]);
    expect(problem.textContent).toContain("The motion of Ada, Bo does not open with your key");
    expect(details.open).toBe(true);
    motions.onUnreadable([]);
    expect([problem.hidden, problem.textContent]).toEqual([true, ""]);
  });

  it("says that nobody draws where this device can't", () => {
    const { setObstacle, problem } = note("m", KEY);
    setObstacle("This browser has no WebGL2");
    expect(problem.textContent).toContain("This browser has no WebGL2. In a sealed meeting no server can draw");
    setObstacle(null);
    expect(problem.hidden).toBe(true);
  });

  it("is none in a meeting that is not sealed", () => {
    expect(sealedNote(null)).toBeNull();
  });
});

describe("opening a sealed meeting", () => {
  const ADA: AnimatablePerson = { personId: "p", name: "Ada", modelId: "a", mine: true };
  const LENT: AnimatablePerson = { personId: "d", name: "Demo", modelId: "d", mine: false };

  function form(onSeal = vi.fn(async (_: AnimatablePerson | null) => undefined)) {
    const listPeople = vi.fn(async () => [LENT, ADA]);
    const element = sealedForm({ listPeople, onSeal });
    document.body.append(element);
    element.dispatchEvent(new Event("toggle"));
    const submit = (): void => void element.querySelector("form")?.dispatchEvent(new Event("submit", { cancelable: true }));
    return { element, onSeal, submit, who: find<HTMLSelectElement>(element, "sealed-who"), go: find<HTMLButtonElement>(element, "sealed-open") };
  }

  it("offers one's own models, or nobody", async () => {
    const { who, submit, onSeal } = form();
    await settled();
    expect([...who.options].map(({ text }) => text)).toEqual(["Ada", "Nobody yet"]);
    submit();
    expect(onSeal).toHaveBeenLastCalledWith(ADA);
    who.selectedIndex = 1;
    submit();
    expect(onSeal).toHaveBeenLastCalledWith(null);
  });

  it("says why it failed, and lets one try again", async () => {
    const { element, go, submit } = form(vi.fn(async () => Promise.reject(new Problem("Refused", "must have a model of splats"))));
    await settled();
    submit();
    expect(go.disabled).toBe(true);
    await settled();
    expect(element.textContent).toContain("must have a model of splats");
    expect(go.disabled).toBe(false);
  });
});
