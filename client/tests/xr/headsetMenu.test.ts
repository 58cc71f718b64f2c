import { describe, expect, it } from "vitest";
import { INITIAL_STATE, type MeetingState } from "../../src/meeting/state";
import { ViewerRig } from "../../src/xr/rig";
import { itemAt, MENU_PX, menuItems, REPLIES, type MenuItem } from "../../src/xr/menu";
import { ellipsize } from "../../src/xr/paint";
import { Pointers, type Aim } from "../../src/xr/pointers";
import { StatusText } from "../../src/xr/statusText";
import type { MeetingSession } from "../../src/meeting/session";
import { member } from "../fakes";

const state = (part: Partial<MeetingState> = {}): MeetingState => ({
  ...INITIAL_STATE,
  me: "a",
  members: [member({ id: "a", name: "Ada" }), member({ id: "b", name: "Bo", microphone: true })],
  ...part,
});
const labels = (items: readonly MenuItem[]): string[] => items.map(({ label }) => label);
const named = (items: readonly MenuItem[], label: string): MenuItem => items.find((item) => item.label === label) as MenuItem;

describe("menuItems", () => {
  it("has the page's words, each button where a ray finds it", () => {
    const items = menuItems(state(), null, false);
    expect(labels(items)).toEqual([
      "People", "Chat", "Unmute", "Raise hand", "React", "Leave", "Turn left", "Stand up", "Turn right",
    ]);
    for (const item of items) {
      expect(itemAt(items, item.x + item.width / 2, item.y + item.height / 2)).toBe(item);
      expect(item.x + item.width).toBeLessThanOrEqual(MENU_PX.width + 0.01);
      expect(item.y + item.height).toBeLessThanOrEqual(MENU_PX.height);
    }
    expect(itemAt(items, 10, 10)).toBeNull();
  });

  it("tells what is on, and bars what a viewer may not", () => {
    const heard = menuItems(state({ members: [member({ id: "a", microphone: true, hand_at: "2026-01-01T00:00:00Z" })] }), "people", true);
    expect(named(heard, "Mute").pressed).toBe(true);
    expect(named(heard, "Raise hand").action).toEqual({ kind: "send", message: { type: "hand", raised: false } });
    expect(named(heard, "Sit down").action).toEqual({ kind: "height" });
    const viewer = menuItems(state({ members: [member({ id: "a", role: "viewer" })] }), "chat", false);
    const mute = named(viewer, "Unmute");
    expect(itemAt(viewer, mute.x + 1, mute.y + 1)).toBeNull();
    expect(named(viewer, "Yes").disabled).toBe(true);
  });

  it("lists people, and says how many more there are", () => {
    const items = menuItems(state(), "people", false);
    expect(labels(items)).toEqual(expect.arrayContaining(["Ada (you)", "Bo"]));
    expect(named(items, "Bo").icon).toBe("mic");
    const many = Array.from({ length: 12 }, (_, n) => member({ id: `${n}`, name: `N${n}` }));
    expect(labels(menuItems(state({ members: many }), "people", false))).toContain("and 6 more");
  });

  it("shows the last messages, with replies that need no keyboard", () => {
    const said = Array.from({ length: 9 }, (_, n) => ({
      type: "said" as const,
      number: n + 1,
      participant_id: n % 2 ? "a" : "b",
      name: n % 2 ? "Ada" : "Bo",
      text: `message ${n}`,
      at: "2026-01-01T00:00:00Z",
    }));
    const items = menuItems(state({ messages: said }), "chat", false);
    expect(items.filter(({ strong }) => strong).map(({ strong, label }) => `${strong}: ${label}`)).toEqual([
      "Bo: message 4", "You: message 5", "Bo: message 6", "You: message 7", "Bo: message 8",
    ]);
    for (const text of REPLIES) expect(named(items, text).action).toEqual({ kind: "send", message: { type: "say", text } });
    expect(labels(menuItems(state(), "chat", false))).toContain("Nobody has written yet.");
    expect(named(menuItems(state(), "react", false), "Celebrate").action).toEqual({
      kind: "send",
      message: { type: "react", reaction: "party" },
    });
  });
});

describe("ellipsize", () => {
  it("cuts what is too wide at the end, between letters", () => {
    const ruler = { measureText: (text: string) => ({ width: 10 * [...text].length }) } as unknown as CanvasRenderingContext2D;
    expect(ellipsize(ruler, "short", 50)).toBe("short");
    expect(ellipsize(ruler, "a longer line", 80)).toBe("a longe…");
    expect(ellipsize(ruler, "🎉🎉🎉🎉", 30)).toBe("🎉🎉…");
    expect(ellipsize(ruler, "x", 0)).toBe("…");
  });
});

describe("Pointers", () => {
  const source = (axes: number[] = []): XRInputSource & { gamepad: { axes: number[] } } =>
    ({ targetRaySpace: new EventTarget(), gamepad: { axes } }) as never;
  const items = menuItems(state(), null, false);
  const quad = { middle: [0, 1, -1], right: [0.5, 0, 0], up: [0, 0.4, 0] } as const;

  /** A session with one controller, which points from in front of the board at a place on it or the floor. */
  function held(input = source()): { session: EventTarget; say(kind: string): void; aim(at: MenuItem | null): Aim } {
    const session = Object.assign(new EventTarget(), { inputSources: [input] });
    const pointers = new Pointers(session as unknown as XRSession);
    const say = (kind: string): void => {
      session.dispatchEvent(Object.assign(new Event(kind), { inputSource: input, removed: [input] }));
    };
    const aim = (at: MenuItem | null): Aim => {
      const x = at ? ((at.x + at.width / 2) / MENU_PX.width - 0.5) * 1 : 0;
      const y = at ? 1 + (0.5 - (at.y + at.height / 2) / MENU_PX.height) * 0.8 : 1;
      const straight = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, 0, 1];
      const down = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 1, 0, 1];
      const frame = { getPose: () => ({ transform: { matrix: at ? straight : down } }) };
      const [only] = pointers.aims(frame as never, new EventTarget(), new ViewerRig(), { quad, items });
      return only as Aim;
    };
    return { session, say, aim };
  }

  it("press what they are let go of where it was pressed", () => {
    const { say, aim } = held();
    const leave = named(items, "Leave");
    expect(aim(leave)).toMatchObject({ pressed: null, target: { kind: "item", item: { label: "Leave" } } });
    say("selectstart");
    expect(aim(leave).pressed).toBeNull();
    say("selectend");
    expect(aim(leave).pressed).toMatchObject({ item: { label: "Leave" } });
    expect(aim(leave).pressed).toBeNull();
  });

  it("press nothing where they slid off a button, and step where they ended on the floor", () => {
    const { say, aim } = held();
    say("selectstart");
    aim(named(items, "Leave"));
    say("selectend");
    expect(aim(named(items, "Chat")).pressed).toBeNull();
    say("selectstart");
    aim(null);
    say("selectend");
    expect(aim(null).pressed).toMatchObject({ kind: "floor" });
    say("selectstart");
    aim(null);
    say("inputsourceschange");
    say("selectend");
    expect(aim(null).pressed).toBeNull();
  });

  it("turn once for each push of the stick", () => {
    const input = source([0, 0, 0, 0]);
    const { aim } = held(input);
    const turns = [0.2, 0.9, 0.95, 0.5, 0.1, -0.7, -0.2].map((x) => {
      input.gamepad.axes[2] = x;
      return aim(null).turned;
    });
    expect(turns).toEqual([0, 1, 0, 0, 0, -1, 0]);
  });
});

describe("StatusText", () => {
  const here = { obstacle: null, drawable: true };

  it("show what was written, shown and spoken for a while, the newest last", () => {
    let hear = (): void => undefined;
    const meetingSession = {
      state: state(),
      connectionState: { kind: "open" },
      onReaction: () => undefined,
      subscribe: (listener: () => void) => ((hear = listener), listener(), () => undefined),
    } as unknown as MeetingSession;
    const words = new StatusText(meetingSession);
    const told = (part: Partial<MeetingState>): void => {
      meetingSession.state = { ...meetingSession.state, ...part };
      hear();
    };
    const by = { participant_id: "b", name: "Bo" };
    told({ messages: [{ type: "said", number: 1, at: "", text: "Hello", ...by }] });
    expect(words.lines(0, here)).toEqual(["Bo: Hello"]);
    told({ caption: { type: "captioned", number: 1, text: "I sp", ...by } });
    told({ caption: { type: "captioned", number: 2, text: "I speak", ...by } });
    meetingSession.onReaction({ type: "reacted", number: 2, reaction: "party", at: "", ...by } as never);
    expect(words.lines(1000, here)).toEqual(["Bo: Hello", "Bo: I speak", "Bo: Celebrate"]);
    expect(words.lines(6500, here)).toEqual(["Bo: I speak", "Bo: Celebrate"]);
    told({ speaking: ["b"] });
    expect(words.lines(9000, { obstacle: "Nobody is here yet", drawable: false })).toEqual(["Nobody is here yet", "Bo speaks"]);
    told({ speaking: [] });
    expect(words.lines(9000, { obstacle: null, drawable: false })).toEqual(["Preparing the picture"]);
    words.close();
  });
});
