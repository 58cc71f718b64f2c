import { describe, expect, it } from "vitest";
import { Problem } from "../../src/api/problem";
import { clipProblem, saidToYou } from "../../src/enrolment/plainWords";

describe("saidToYou", () => {
  it.each([
    ["Hardly seen of the person: left. Turn once.", "Hardly seen of you: left. Turn once."],
    ["The person was lost in 3 of 9 frames: stay inside the picture.", "You were lost in 3 of 9 frames: stay inside the picture."],
    ["The person is only 90 px tall: come closer.", "You are only 90 px tall: come closer."],
    ["the clip must show a person; got nobody in 9 frames; film one person, well lit", "the clip must show you; got nobody in 9 frames; film yourself alone, well lit"],
    ["the person must be seen in 5 frames; got 2; keep one person inside the picture", "you must be seen in 5 frames; got 2; stay alone inside the picture"],
    ["The picture is blurred: add light.", "The picture is blurred: add light."],
  ])("says “%s” to whom it is about", (said, ours) => {
    expect(saidToYou(said)).toBe(ours);
  });
});

describe("clipProblem", () => {
  it("heads what is wrong with a clip in plain words, and leaves other headings", () => {
    const headed = (problem: Problem): string => clipProblem(problem).title;
    expect(headed(new Problem("Invalid input", "It has one frame.", 422))).toBe("This clip cannot be used");
    expect(headed(new Problem("No space left", "The disk is full.", 507))).toBe("No space left");
  });
});
