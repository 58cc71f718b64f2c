// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Api } from "../../src/api/api";
import type { Job } from "../../src/api/types";
import type { EnrolState } from "../../src/enrolment/enrol";
import { previewPane } from "../../src/views/previewPane";
import { job } from "../fakes";

const settled = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));

/** A pane, and the jobs whose previews it asked for. */
function setUp() {
  const asked: string[] = [];
  const preview = async (id: string): Promise<Blob> => (asked.push(id), new Blob(["picture"]));
  const pane = previewPane({ preview } as unknown as Api, null);
  const show = async (part: Partial<Job>): Promise<void> => {
    pane.show({ job: job({ has_preview: true, ...part }) } as EnrolState);
    await settled();
  };
  return { pane, asked, show };
}

beforeEach(() => {
  HTMLImageElement.prototype.decode = async () => undefined;
  URL.createObjectURL = () => "blob:picture";
  URL.revokeObjectURL = () => undefined;
});
afterEach(() => vi.restoreAllMocks());

describe("previewPane", () => {
  it("keeps the first likeness until a training has come further than that", async () => {
    const { pane, asked, show } = setUp();
    await show({ id: "capture", kind: "capture", progress: 0.6 });
    await show({ id: "training", kind: "train", progress: 0 });
    await show({ id: "training", kind: "train", progress: 0.05 });
    expect(asked).toEqual(["capture"]);
    expect(pane.element.classList.contains("has-preview")).toBe(true);
    await show({ id: "training", kind: "train", progress: 0.2 });
    expect(asked).toEqual(["capture", "training"]);
  });
});
