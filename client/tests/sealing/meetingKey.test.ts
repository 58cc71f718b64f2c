import { describe, expect, it } from "vitest";
import { MeetingKey, linkWithKey } from "../../src/sealing/meetingKey";
import { CASES, KEY } from "./cases";

describe("MeetingKey", () => {
  it("is read from a link as it was written into it", () => {
    for (let i = 0; i < 50; i++) {
      const { text } = MeetingKey.random();
      expect(text).toMatch(/^[\w-]{22}$/);
      expect(MeetingKey.read(text)?.text).toBe(text);
    }
  });

  it("is drawn anew each time", () => {
    expect(new Set(Array.from({ length: 50 }, () => MeetingKey.random().text)).size).toBe(50);
  });

  it.each([null, "", "short", "x".repeat(23), "no spaces in base64url", "++++++++++++++++++++++"])("is not read from %s", (text) => {
    expect(MeetingKey.read(text)).toBeNull();
  });

  it("has the code that another library finds, which depends on key and meeting", async () => {
    expect(await KEY.code(CASES.meeting)).toBe(CASES.code);
    expect(await KEY.code("another")).not.toBe(CASES.code);
    expect(await MeetingKey.random().code(CASES.meeting)).not.toBe(CASES.code);
  });
});

describe("linkWithKey", () => {
  it("puts the key behind the #, beside a token or alone", () => {
    const read = (link: string): [string, URLSearchParams] => [new URL(link).search, new URLSearchParams(new URL(link).hash.slice(1))];
    for (const [link, token] of [["https://a.example/?meeting=m", null], ["https://a.example/?meeting=m#token=t", "t"]] as const) {
      const [search, secrets] = read(linkWithKey(link, KEY));
      expect([search, secrets.get("token"), secrets.get("key")]).toEqual(["?meeting=m", token, CASES.key]);
    }
  });

  it("leaves the link of a meeting that is not sealed alone", () => {
    expect(linkWithKey("https://a.example/?meeting=m#token=t", null)).toBe("https://a.example/?meeting=m#token=t");
  });
});
