import { describe, expect, it } from "vitest";
import { advice, qualityLines } from "../../src/enrolment/quality";
import { cameraProblem, openCamera } from "../../src/capture/record";
import { sequence } from "../fakes";

describe("a capture's report", () => {
  it("is told in plain words", () => {
    const quality = {
      frames_used: 110,
      coverage: { front: 0.6, left: 0.2, back: 0, right: 0.2 },
      mask_overlap: 0.7,
      blur: 9.5,
      legs_seen: false,
      advice: ["Turn all the way round.", 3],
    };
    const told = sequence({ quality: quality as unknown as { advice: string[] } });
    expect(qualityLines(told)).toEqual([
      { label: "Pictures used", value: "110", level: "good" },
      { label: "Sides seen", value: "Front, left and right", level: "fair" },
      { label: "Outline", value: "Fair", level: "fair" },
      { label: "Sharpness", value: "Blurred", level: "poor" },
      { label: "Legs", value: "Not seen", level: "fair" },
    ]);
    expect(advice(told)).toEqual(["Turn all the way round."]);
  });

  it("says nothing about what it does not know", () => {
    expect(qualityLines(sequence({ frames: null, quality: { coverage: null } }))).toEqual([]);
    expect(advice(sequence())).toEqual([]);
  });

  it("praises a full turn", () => {
    const coverage = { front: 0.3, left: 0.2, back: 0.3, right: 0.2 };
    const lines = qualityLines(sequence({ frames: null, quality: { coverage } }));
    expect(lines).toEqual([{ label: "Sides seen", value: "All round", level: "good" }]);
  });
});

describe("filming", () => {
  it("says what to do when the camera can't be had", async () => {
    expect(cameraProblem("NotAllowedError").detail).toMatch(/allow it/i);
    expect(cameraProblem("NotFoundError").title).toBe("No camera found");
    expect(cameraProblem("NotReadableError").title).toBe("The camera is busy");
    expect(cameraProblem("").detail).toMatch(/upload/i);
    await expect(openCamera()).rejects.toThrow("can't be used on this page");
  });
});
