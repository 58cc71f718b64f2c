import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Dictation, recognitionOf } from "../../src/meeting/dictation";

class FakeRecognition extends EventTarget {
  static made: FakeRecognition[] = [];
  continuous = false;
  lang = "";
  running = false;
  constructor() {
    super();
    FakeRecognition.made.push(this);
  }
  start(): void {
    this.running = true;
  }
  abort(): void {
    this.running = false;
    this.dispatchEvent(new Event("end"));
  }
  hear(...sentences: [string, boolean][]): void {
    const results = sentences.map(([transcript, isFinal]) => Object.assign([{ transcript }], { isFinal }));
    this.dispatchEvent(Object.assign(new Event("result"), { resultIndex: 0, results }));
  }
  fail(error: string): void {
    this.dispatchEvent(Object.assign(new Event("error"), { error }));
    this.dispatchEvent(new Event("end"));
  }
}

function setUp() {
  const texts: string[] = [];
  const refused: number[] = [];
  const dictation = new Dictation(FakeRecognition, (text) => texts.push(text), () => refused.push(1));
  return { dictation, texts, refused, newest: () => FakeRecognition.made.at(-1) as FakeRecognition };
}

describe("dictation", () => {
  beforeEach(() => {
    FakeRecognition.made = [];
    vi.useFakeTimers();
  });
  afterEach(() => vi.useRealTimers());

  it("tells finished sentences while it is on", () => {
    const { dictation, texts, newest } = setUp();
    dictation.listen(true);
    newest().hear(["half a", false]);
    newest().hear(["  Half a sentence ", true], ["and", false]);
    dictation.listen(false);
    expect(newest().running).toBe(false);
    newest().hear(["Nobody asked", true]);
    expect(texts).toEqual(["Half a sentence"]);
  });

  it("begins again where the browser ended it, and stays off once off", async () => {
    const { dictation } = setUp();
    dictation.listen(true);
    FakeRecognition.made[0]?.fail("no-speech");
    await vi.advanceTimersByTimeAsync(400);
    expect(FakeRecognition.made).toHaveLength(2);
    dictation.listen(false);
    await vi.advanceTimersByTimeAsync(1000);
    expect(FakeRecognition.made).toHaveLength(2);
  });

  it("says when it is not allowed, and does not try again", async () => {
    const { dictation, refused } = setUp();
    dictation.listen(true);
    FakeRecognition.made[0]?.fail("not-allowed");
    await vi.advanceTimersByTimeAsync(1000);
    expect([refused.length, FakeRecognition.made.length]).toEqual([1, 1]);
  });

  it("is found under both names, or not at all", () => {
    expect(recognitionOf({ webkitSpeechRecognition: FakeRecognition })).toBe(FakeRecognition);
    expect(recognitionOf({})).toBeNull();
  });
});
