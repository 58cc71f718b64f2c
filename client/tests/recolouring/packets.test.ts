import { describe, expect, it } from "vitest";
import { decodeLook } from "../../src/recolouring/packets";

/** Pose, of one turn, of the second of three, of whom tests call Ada: tests/services/live/test_pose_feed.py. */
const POSE = "01020000" + "07000000" + "0000000000709740" + "01036887" + "0000003f" + "0000803f" + "000000c0" + "b6b6ed6d5b6b" + "004000200010".repeat(23);
/** As in tests/services/live/test_look_feed.py. */
const KEY_FRAME = "0104010368870100" + "02010000" + "106b6579";
const FRAME = "0104010368870000" + "03010000" + "116e657874";
const END = "010601036887000000000000";

const bytes = (hex: string): ArrayBuffer => Uint8Array.from(hex.match(/../g) ?? [], (two) => parseInt(two, 16)).buffer;
const ADA = { index: 1, count: 3, check: 0x8768 };

describe("decodeLook", () => {
  it("reads frames as they were sent, and which are key frames", () => {
    expect(decodeLook(bytes(KEY_FRAME))).toEqual({ kind: "frame", ...ADA, number: 258, key: true, data: new TextEncoder().encode("\x10key") });
    expect(decodeLook(bytes(FRAME))).toEqual({ kind: "frame", ...ADA, number: 259, key: false, data: new TextEncoder().encode("\x11next") });
  });

  it("reads where somebody was, by what lens", () => {
    const lens = "00006144" + "00806344" + "00000c43" + "00001643";
    const read = decodeLook(bytes("0105010368870000" + "02010000" + lens + POSE));
    expect(read).toMatchObject({ kind: "pose", ...ADA, number: 258, lens: [900, 910, 140, 150] });
    expect(read?.kind === "pose" && read.pose).toMatchObject({ captureTimeMs: 1500, pelvis: [0.5, 1, -2] });
  });

  it("reads the end", () => {
    expect(decodeLook(bytes(END))).toEqual({ kind: "end", ...ADA });
  });

  it.each(["", END.slice(2), "02" + END.slice(2), "0107" + END.slice(4), "0105010368870000" + "02010000" + "00".repeat(17)])(
    "takes nothing from %s",
    (hex) => expect(decodeLook(bytes(hex))).toBeNull(),
  );
});
