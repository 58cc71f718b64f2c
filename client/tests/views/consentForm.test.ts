// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import type { Consent } from "../../src/api/types";
import { consentForm, consentWords, endOf, lastDay } from "../../src/views/consentForm";
import { find } from "./inside";

const GIVEN: Consent = { purposes: ["meetings", "recordings"], until: null, state: "given", revoked_at: null };

describe("the form of a consent", () => {
  it("begins with meetings and recordings, without an end, and nobody else moves the model", () => {
    expect(consentForm("a").read()).toEqual({ purposes: ["meetings", "recordings"], until: null });
  });

  it("asks for nothing more where the model is not to be shown", () => {
    const { element, read } = consentForm("a", { purposes: ["meetings", "driving"] });
    const meetings = find<HTMLInputElement>(element, "a-meetings");
    meetings.checked = false;
    meetings.dispatchEvent(new Event("change"));
    expect(find<HTMLInputElement>(element, "a-driving").disabled).toBe(true);
    expect(read()).toEqual({ purposes: [], until: null });
  });

  it("holds through the day that is chosen, and shows that day again", () => {
    const { element, read } = consentForm("a");
    find<HTMLInputElement>(element, "a-until").value = "2030-12-31";
    const { until } = read();
    expect(until).toBe(new Date(2031, 0, 1).toISOString());
    expect(lastDay(until ?? "")).toBe("2030-12-31");
    expect(lastDay(endOf("2028-02-29"))).toBe("2028-02-29");
  });
});

describe("the words of a consent", () => {
  it("name what it is for and its end", () => {
    expect(consentWords({ ...GIVEN, purposes: ["meetings", "driving"] })).toBe("Consent given for meetings, being moved by others; no end is set.");
    expect(consentWords({ ...GIVEN, until: endOf("2030-05-04") })).toMatch(/^Consent given for meetings, recordings; until .*2030\.$/);
    expect(consentWords({ ...GIVEN, purposes: [] })).toContain("only you can see the model");
  });
});
