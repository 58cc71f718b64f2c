import { describe, expect, it } from "vitest";
import { modelLines } from "../../src/enrolment/modelReport";

const tried = [
  { splats: 17607, good: false, lost_db: { body: 0.04, face: -0.127 } },
  { splats: 35215, good: true, lost_db: { body: 0.008, face: -0.051 } },
  { splats: 24901, good: true, lost_db: { body: 0.013, face: 0.126 } },
];

describe("a model's report", () => {
  it("tells what was kept, what that cost and what was too little", () => {
    const lines = modelLines({ metrics: { size: { asked: "auto", of: 49801, kept: 24901, tried } } });
    expect(lines.map(({ label, value }) => [label, value])).toEqual([
      ["Points kept", "24,901 of 49,801"],
      ["What that costs", "0.1 dB at most"],
      ["Too few", "17,607"],
    ]);
  });

  it("costs nothing where all are kept", () => {
    const all = { asked: "auto", of: 10000, kept: 10000, tried: [{ splats: 7071, good: false, lost_db: {} }] };
    expect(modelLines({ metrics: { size: all } }).map(({ value }) => value)).toEqual(["10,000 of 10,000", "7,071"]);
  });

  it("says nothing of what was not asked", () => {
    expect(modelLines({ metrics: {} })).toEqual([]);
    expect(modelLines({ metrics: { size: { asked: 3000, of: 6000, kept: 3000 } } })).toEqual([]);
  });
});
