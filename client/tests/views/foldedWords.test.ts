// @vitest-environment happy-dom
import { afterEach, describe, expect, it, vi } from "vitest";
import { foldedWords } from "../../src/views/foldedWords";

describe("foldedWords", () => {
  afterEach(() => vi.unstubAllGlobals());
  const inWindow = (narrow: boolean): void => void vi.stubGlobal("matchMedia", () => ({ matches: narrow }));

  it("explains openly where there is room, and folded in a narrow window", () => {
    inWindow(false);
    expect((foldedWords("a", "Why", "Because.").element as HTMLDetailsElement).open).toBe(true);
    inWindow(true);
    const { element } = foldedWords("a", "Why", "Because.");
    expect([(element as HTMLDetailsElement).open, element.textContent]).toEqual([false, "WhyBecause."]);
  });

  it("says openly what has happened, and folds again", () => {
    inWindow(true);
    const words = foldedWords("a", "Why", "Because.");
    words.say("It was lost.");
    expect([(words.element as HTMLDetailsElement).open, words.element.querySelector("#a")?.textContent]).toEqual([true, "It was lost."]);
    words.explain();
    expect([(words.element as HTMLDetailsElement).open, words.element.querySelector("#a")?.textContent]).toEqual([false, "Because."]);
  });
});
