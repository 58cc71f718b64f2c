// @vitest-environment happy-dom
import { beforeEach, describe, expect, it } from "vitest";
import type { NewPerson } from "../../src/api/types";
import { enrolForm } from "../../src/views/enrolForm";
import { metres } from "../../src/views/heightField";

function find<Kind extends HTMLElement>(testId: string): Kind {
  const found = document.querySelector<Kind>(`[data-testid="${testId}"]`);
  if (!found) throw new Error(`${testId} is not there`);
  return found;
}

function type(testId: string, text: string): HTMLInputElement {
  const field = find<HTMLInputElement>(testId);
  field.value = text;
  field.dispatchEvent(new Event("input"));
  return field;
}

/** Typed, and the field left. */
function enter(testId: string, text: string): HTMLInputElement {
  const field = type(testId, text);
  field.dispatchEvent(new Event("change"));
  return field;
}

/** The form with a clip chosen and a name told; `enrolled` is who came of it. */
/** What is consented to where nothing is changed in the form. */
const USUAL = { purposes: ["meetings", "recordings"], until: null };

async function readyForm(): Promise<NewPerson[]> {
  const enrolled: NewPerson[] = [];
  const hooks = {
    onEnrol: (newcomer: NewPerson) => void enrolled.push(newcomer),
    listPeople: async () => [],
    onAnimate: async () => undefined,
  };
  document.body.replaceChildren(enrolForm(hooks).element);
  const file = find<HTMLInputElement>("enrol-file");
  Object.defineProperty(file, "files", { value: [new File(["clip"], "me.mp4", { type: "video/mp4" })] });
  file.dispatchEvent(new Event("change"));
  enter("enrol-name", "Ada");
  await new Promise((resolve) => setTimeout(resolve));
  return enrolled;
}

function submit(): void {
  document.querySelector("form")?.dispatchEvent(new Event("submit", { cancelable: true }));
}

beforeEach(() => localStorage.clear());

describe("The enrolment form", () => {
  it("tells a height in metres, and none where none was told", async () => {
    const enrolled = await readyForm();
    submit();
    enter("enrol-height", " 178,5 cm");
    submit();
    expect(enrolled).toEqual([
      { name: "Ada", height_m: null, consent: USUAL },
      { name: "Ada", height_m: 1.785, consent: USUAL },
    ]);
  });

  it("comes back as it was sent", () => {
    const sent: unknown[] = [];
    const hooks = { onEnrol: (...all: unknown[]) => void sent.push(all), listPeople: async () => [], onAnimate: async () => undefined };
    const newcomer: NewPerson = { name: "Ada", height_m: 1.785, consent: { purposes: ["meetings"], until: null } };
    const clip = { blob: new Blob(["clip"]), fileName: "me.mp4", modelOnly: true };
    document.body.replaceChildren(enrolForm(hooks, { newcomer, clip }).element);
    expect(document.querySelector(".chosen")?.textContent).toContain("me.mp4");
    submit();
    expect(sent).toEqual([[newcomer, clip]]);
  });

  it("complains of what is no height beside the field, and sends nothing until it is mended", async () => {
    const enrolled = await readyForm();
    const complaint = find("height-error");
    const field = enter("enrol-height", "1.78");
    expect(complaint.textContent).toBe("Enter a height from 50 to 250 cm, or leave the field empty.");
    expect(field.getAttribute("aria-invalid")).toBe("true");
    expect(field.getAttribute("aria-describedby")?.split(" ")).toContain(complaint.id);
    submit();
    expect(enrolled).toEqual([]);
    expect(document.activeElement).toBe(field);
    type("enrol-height", "178");
    expect(complaint.textContent).toBe("");
    expect(field.getAttribute("aria-invalid")).toBe("false");
    submit();
    expect(enrolled).toEqual([{ name: "Ada", height_m: 1.78, consent: USUAL }]);
  });

  it("does not complain while somebody is still typing", async () => {
    await readyForm();
    type("enrol-height", "1");
    expect(find("height-error").textContent).toBe("");
  });
});

describe("A height", () => {
  it.each([
    ["", null],
    ["  ", null],
    ["50", 0.5],
    ["250 CM", 2.5],
    ["172.", 1.72],
    ["49.9", undefined],
    ["251", undefined],
    ["-170", undefined],
    ["1e2", undefined],
    ["5'10", undefined],
    ["tall", undefined],
  ])("%j is %s", (text, height_m) => {
    expect(metres(text)).toBe(height_m);
  });
});
