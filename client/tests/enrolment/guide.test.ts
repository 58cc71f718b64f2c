import { describe, expect, it } from "vitest";
import { back, beginGuide, goTo, observe, pass, passedSteps, progressOf, restart, resumeGuide, seenSoFar, skip, type GuideState } from "../../src/enrolment/guide";
import { mostHelpful, nothingSeen, seenInWords, shareAround, shareSeen, withTurn } from "../../src/enrolment/sidesSeen";
import { STEPS, judge, stepOf, type StepName } from "../../src/enrolment/steps";
import type { Landmarks } from "../../src/landmarks/landmarks";
import { sideShown, turnOf } from "../../src/landmarks/turn";
import { DONE, observation, somebody, type Pose } from "./people";

const EVERY_MS = 100;

/** `state` after `ms` of seeing so. */
function watched(state: GuideState, seen: Landmarks | null, ms: number, fromMs = (state.lastMs ?? 0) + EVERY_MS): GuideState {
  let next = state;
  for (let t = 0; t <= ms; t += EVERY_MS) next = observe(next, observation(fromMs + t, seen));
  return next;
}

function at(name: StepName): GuideState {
  return goTo(beginGuide(), name);
}

function told(name: StepName, pose: Pose | null, quality = {}): string {
  return judge(stepOf(name), observation(0, pose && somebody(pose), quality)).words;
}

describe("which way somebody faces", () => {
  it.each([0, 30, 80, -60, 130, 180, -135])("is told of a body turned by %s degrees", (deg) => {
    const { body } = turnOf(somebody({ head: deg, body: deg }));
    expect(Math.cos(((body - deg) * Math.PI) / 180)).toBeCloseTo(1, 4);
  });

  it("is told of the head by itself, until only its back is seen", () => {
    expect(turnOf(somebody({ head: 65, body: 10 })).head).toBeCloseTo(65, 3);
    expect(turnOf(somebody({ head: 20, body: 170 })).head).toBeCloseTo(170, 3);
  });

  it("shows the right side of whoever turns to the left", () => {
    expect([0, 40, 90, 180, -180, -90, 135.1].map(sideShown)).toEqual(["front", "front", "right", "back", "back", "left", "back"]);
  });
});

describe("a step's check", () => {
  it.each(Object.entries(DONE) as [StepName, Landmarks][])("is content with %s as it is asked for", (name, seen) => {
    expect(judge(stepOf(name), observation(0, seen)).rate).toBe(1);
  });

  it.each(STEPS.map(({ name }) => name))("of %s says so where nobody is found, or in the dark", (name) => {
    expect(told(name, null)).toBe("Nobody is in the picture.");
    const guessed = { ...somebody(), visibility: new Float32Array(33).fill(0.2) };
    expect(judge(stepOf(name), observation(0, guessed)).words).toBe("Nobody is in the picture.");
    for (const pose of [{}, null]) expect(told(name, pose, { brightness: 0.1 })).toMatch(/^Too dark/);
  });

  it("asks for a face that is close, whole, and looks at the camera", () => {
    expect(told("face", { headSize: 0.1 })).toMatch(/Come closer/);
    expect(told("face", { headSize: 0.3, nose: [0.98, 0.5] })).toMatch(/not all in the picture/);
    expect(told("face", { headSize: 0.3, nose: [0.5, 0.5], head: 40 })).toMatch(/Look straight/);
  });

  it("asks for more of a turn, the other way, or less distance", () => {
    expect(told("turn_left", { head: 30, headSize: 0.3 })).toBe("Turn farther to the left.");
    expect(told("turn_left", { head: -60, headSize: 0.3 })).toBe("That is your right: turn to your left.");
    expect(told("turn_right", { head: 60, headSize: 0.3 })).toBe("That is your left: turn to your right.");
    expect(told("turn_right", { head: -70, headSize: 0.05 })).toMatch(/Come closer/);
    expect(judge(stepOf("turn_left"), observation(0, somebody({ head: 30, headSize: 0.3 }))).isUnderWay).toBe(true);
    expect(judge(stepOf("turn_left"), observation(0, somebody({ head: 5, headSize: 0.3 }))).isUnderWay).toBe(false);
  });

  it("takes an upper body for whoever stays seated, in twice the time", () => {
    const seated = judge(stepOf("step_back"), observation(0, somebody({ legs: false })));
    expect(seated.rate).toBe(0.5);
    expect(seated.words).toMatch(/or stay seated/);
    expect(told("step_back", { headSize: 0.3, nose: [0.5, 0.5] })).toMatch(/Move back/);
    expect(told("step_back", { body: 80 })).toMatch(/Face the camera/);
  });

  it("names the arm that hangs or is held too high", () => {
    expect(told("arms", { arms: 18 })).toBe("Move your left arm farther out.");
    expect(told("arms", { arms: 85 })).toBe("Lower your left arm.");
    expect(told("arms", { hands: "left only" })).toBe("Lower your left arm.");
    expect(told("arms", { body: 120 })).toMatch(/Face the camera/);
  });

  it("names the hand that is missing", () => {
    expect(told("hands", { hands: "down" })).toMatch(/your left hand/);
    expect(told("hands", { hands: "left only" })).toMatch(/your right hand/);
  });

  it("takes no blurred picture, but tells first what else is wrong", () => {
    expect(told("face", { headSize: 0.3, nose: [0.5, 0.5] }, { sharpness: 0.001 })).toMatch(/^Blurred/);
    expect(told("face", { headSize: 0.1 }, { sharpness: 0.001 })).toMatch(/Come closer/);
  });
});

describe("a guide", () => {
  it("passes a step once it was done for long enough, and goes on to the next", () => {
    const half = watched(beginGuide(), DONE.face, 1500);
    expect(half.current).toBe("face");
    expect(progressOf(half)).toBeCloseTo(0.5, 1);
    const whole = watched(half, DONE.face, 1600);
    expect(whole.current).toBe("turn_left");
    expect(whole.outcomes).toEqual({ face: "passed" });
    expect(progressOf(whole)).toBe(0);
  });

  it("loses a moment for a moment that fails, not all", () => {
    const half = watched(beginGuide(), DONE.face, 2000);
    const lapse = watched(half, null, 400);
    expect(progressOf(lapse)).toBeCloseTo((2000 - 500) / 3000, 2);
    expect(progressOf(watched(lapse, null, 5000))).toBe(0);
  });

  it("believes nothing of the time between two pictures that are far apart", () => {
    const [first, second] = [observation(0, DONE.face), observation(60_000, DONE.face)];
    expect(progressOf(observe(observe(beginGuide(), first), second))).toBeCloseTo(500 / 3000, 5);
  });

  it("shows words once they have held, so that one odd picture changes nothing", () => {
    const calm = watched(beginGuide(), somebody({ headSize: 0.1 }), 500);
    expect(calm.words).toMatch(/Come closer/);
    const odd = observe(calm, observation((calm.lastMs ?? 0) + 50, null));
    expect(odd.words).toMatch(/Come closer/);
    const done = observe(calm, observation((calm.lastMs ?? 0) + 50, DONE.face));
    expect([done.words, done.isGood]).toEqual([calm.words, false]);
    expect(watched(calm, null, 600).words).toBe("Nobody is in the picture.");
  });

  it("walks through every step", () => {
    let state = beginGuide();
    for (const { name } of STEPS) {
      state = resumeGuide(state);
      expect(state.current).toBe(name);
      if (name === "around") for (const deg of [0, 45, 90, 135, 180, -135, -90, 0]) state = watched(state, somebody({ head: deg, body: deg, headSize: 0.07 }), 700);
      else for (let second = 0; state.current === name && second < 5; second++) state = watched(state, DONE[name], 1000);
    }
    expect(state.current).toBeNull();
    expect(passedSteps(state)).toEqual(STEPS.map(({ name }) => name));
    expect(mostHelpful(seenSoFar(state))).toBeNull();
  });

  it("is not once around before every side was seen", () => {
    let state = at("around");
    for (const deg of [0, 60, 90, 120, 180]) state = watched(state, somebody({ head: deg, body: deg, headSize: 0.07 }), 700);
    expect(state.current).toBe("around");
    expect(progressOf(state)).toBeCloseTo(0.75, 5);
    state = watched(state, somebody({ head: -90, body: -90, headSize: 0.07 }), 1500);
    expect([state.current, progressOf(state), state.words]).toEqual(["around", 1, "Turn on until you face the camera again."]);
    expect(watched(state, somebody({ headSize: 0.07 }), 0).outcomes.around).toBe("passed");
  });

  it("skips a step with what was seen in it, and comes back to it", () => {
    const begun = watched(at("turn_left"), DONE.turn_left, 800);
    expect(shareSeen(seenSoFar(begun), "head", "right")).toBe(1);
    const skipped = skip(begun);
    expect(skipped.outcomes.turn_left).toBe("skipped");
    expect(seenSoFar(skipped)).toEqual(nothingSeen());
    const again = goTo(skipped, "turn_left");
    expect([again.current, again.outcomes.turn_left]).toEqual(["turn_left", undefined]);
  });

  it("goes back a step, also from the end, and from the first nowhere", () => {
    const end = STEPS.reduce((state) => skip(state), beginGuide());
    expect(end.current).toBeNull();
    expect(back(end).current).toBe("hands");
    expect(back(at("turn_right")).current).toBe("turn_left");
    const first = beginGuide();
    expect(back(first)).toBe(first);
    expect(skip(end)).toBe(end);
  });

  it("goes on with the step that was left when another has been done anew", () => {
    const third = pass(pass(beginGuide()));
    expect(third.current).toBe("turn_right");
    expect(pass(goTo(third, "face")).current).toBe("turn_right");
  });

  it("outlives the page at the beginning of its step", () => {
    const amid = watched(pass(beginGuide()), DONE.turn_left, 700);
    const stored = JSON.parse(JSON.stringify(amid)) as GuideState;
    const resumed = resumeGuide(stored);
    expect(resumed.current).toBe("turn_left");
    expect(resumed.outcomes).toEqual({ face: "passed" });
    expect(progressOf(resumed)).toBe(0);
    expect(resumed.seen.turn_left).toBeUndefined();
    expect(observe(resumed, observation(1e9, DONE.turn_left)).heldMs).toBe(0);
  });

  it("says when something is worth recording, and forgets it where the step begins anew", () => {
    const waiting = watched(at("turn_left"), somebody({ headSize: 0.3 }), 500);
    expect(waiting.isUnderWay).toBe(false);
    const turning = watched(waiting, somebody({ headSize: 0.3, head: 30 }), 100);
    expect([turning.isUnderWay, turning.isGood]).toEqual([true, false]);
    expect(restart(turning)).toMatchObject({ current: "turn_left", isUnderWay: false, heldMs: 0, words: turning.words });
  });
});

describe("what was seen", () => {
  it("grows with time, each part by itself, and a body too close shows none", () => {
    const seen = withTurn(withTurn(nothingSeen(), { head: 80, body: 10 }, 300), { head: 80, body: null }, 300);
    expect(shareSeen(seen, "head", "right")).toBe(1);
    expect(shareSeen(seen, "body", "front")).toBe(0.5);
    expect(shareAround(seen)).toBe(0.125);
    const close = watched(beginGuide(), DONE.face, 1000);
    expect(shareSeen(seenSoFar(close), "head", "front")).toBe(1);
    expect(shareSeen(seenSoFar(close), "body", "front")).toBe(0);
  });

  it("is told in words, with what would help most", () => {
    let seen = nothingSeen();
    expect(seenInWords(seen)).toBe("Seen of your head: nothing yet. Of your body: nothing yet.");
    const hints: (string | undefined)[] = [];
    for (const turn of [0, 90, -90, 180]) {
      hints.push(mostHelpful(seen)?.words);
      seen = withTurn(seen, { head: turn, body: turn }, 1000);
    }
    expect(hints).toEqual(["Look straight at the camera.", "Turn your head to the left.", "Turn your head to the right.", "Turn your back to the camera."]);
    expect(mostHelpful(seen)).toBeNull();
    expect(seenInWords(seen)).toBe("Seen of your head: front, left, back, right. Of your body: front, left, back, right.");
  });
});
