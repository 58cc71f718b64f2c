import { describe, expect, it } from "vitest";
import { INITIAL_STATE, applyMessage, admittedMembers, isHost, nameOf, announcementsOf, activeSpeakers, waitingMembers, type MeetingState } from "../../src/meeting/state";
import type { FromServer, Member } from "../../src/api/types";
import { member } from "../fakes";

function told(...messages: FromServer[]): MeetingState {
  return messages.reduce(applyMessage, INITIAL_STATE);
}

const welcome: FromServer = { type: "welcome", participant_id: "me", seat: 1, silence_s: 5 };
const roster = (...members: Member[]): FromServer => ({ type: "roster", lobby: true, environment: "studio", presenter_id: null, presenter_asks_id: null, recording: null, members, performer_ids: ["p"] });
const said = (number: number, text = "x"): FromServer => ({
  type: "said", number, participant_id: "bo", name: "Bo", text, at: "2026-01-01T10:00:00Z",
});

describe("the meeting state", () => {
  it("puts raised hands first, the longest raised before others", () => {
    const state = told(
      welcome,
      roster(
        member({ id: "me", role: "host" }),
        member({ id: "late", hand_at: "2026-01-01T10:00:09Z" }),
        member({ id: "early", hand_at: "2026-01-01T10:00:01Z" }),
        member({ id: "door", admission: "waiting" }),
      ),
    );
    expect(admittedMembers(state).map(({ id }) => id)).toEqual(["early", "late", "me"]);
    expect(waitingMembers(state).map(({ id }) => id)).toEqual(["door"]);
    expect(isHost(state)).toBe(true);
  });

  it("takes a message that comes twice, as after a cut, once", () => {
    const state = told(welcome, said(1), said(2), said(2), said(1));
    expect(state.messages.map(({ number }) => number)).toEqual([1, 2]);
    const after = applyMessage(state, { type: "reacted", number: 5, participant_id: "bo", name: "Bo", reaction: "heart" });
    expect(after.lastMessageNumber).toBe(5);
    expect(after.messages).toBe(state.messages);
  });

  it("names the others who speak", () => {
    const here = told(welcome, roster(member({ id: "me" }), member({ id: "Bo" })));
    const state = applyMessage(here, { type: "speaking", slots: [], participant_ids: ["Bo", "me", "gone"] });
    expect(activeSpeakers(state)).toEqual(["Bo"]);
  });

  it("tells who comes, goes, knocks, raises a hand, is lost and is back", () => {
    const before = told(welcome, roster(
      member({ id: "me" }),
      member({ id: "Bo" }),
      member({ id: "Cy" }),
      member({ id: "Di", present: false }),
      member({ id: "Ed" }),
    ));
    const after = applyMessage(before, roster(
      member({ id: "me", role: "host" }),
      member({ id: "Bo", hand_at: "2026-01-01T10:00:01Z" }),
      member({ id: "Di" }),
      member({ id: "Ed", present: false }),
      member({ id: "Fay", admission: "waiting" }),
      member({ id: "Gus" }),
    ));
    expect(announcementsOf(before, after)).toEqual([
      "You are now the host",
      "Bo raised a hand",
      "Di is back",
      "Ed lost the connection",
      "Fay is asking to join",
      "Gus joined",
      "Cy left",
    ]);
  });

  it("makes no news of those who were there when we came in", () => {
    const outside = told(welcome, roster(member({ id: "me", admission: "waiting" })));
    const in_ = applyMessage(outside, roster(member({ id: "me" }), member({ id: "Bo" })));
    expect(announcementsOf(outside, in_)).toEqual([]);
    expect(announcementsOf(INITIAL_STATE, in_)).toEqual([]);
  });
});

describe("what else a meeting is told", () => {
  const told = { type: "captioned", number: 4, participant_id: "bo", name: "Bo", text: "Good morning" } as const;

  it("keeps the newest caption, and counts it", () => {
    const state = applyMessage(INITIAL_STATE, told);
    expect(state.caption?.text).toBe("Good morning");
    expect(state.lastMessageNumber).toBe(4);
    expect(applyMessage(state, { ...told, number: 5, text: "And more" }).caption?.text).toBe("And more");
  });

  it("knows names, and of who is gone none", () => {
    const state = { ...INITIAL_STATE, members: [member({ id: "bo", name: "Bo" })] };
    expect(nameOf(state, "bo")).toBe("Bo");
    expect(nameOf(state, "cy")).toBe("");
  });
});
