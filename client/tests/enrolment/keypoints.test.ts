import { describe, expect, it } from "vitest";
import type { Api } from "../../src/api/api";
import { animatablePeople, isJson, createKeypointsMeeting } from "../../src/enrolment/keypoints";
import type { HashedClip } from "../../src/api/upload";
import { hashClip, sequence } from "../fakes";

const ADA = { personId: "a", name: "Ada", modelId: "a2", mine: true };
const KEYPOINTS = new File(['\n{"format": "metanerf-keypoints"}'], "wave.json");
const never = new AbortController().signal;

class FakeServer {
  calls: unknown[][] = [];
  people = async () => [
    { id: "a", name: "Ada", mine: true },
    { id: "b", name: "Bob", mine: false },
    { id: "n", name: "Not trained", mine: true },
  ];
  models = async () => [
    { id: "a1", person_id: "a" },
    { id: "b1", person_id: "b" },
    { id: "a2", person_id: "a" },
  ];
  hashClip = hashClip;
  uploadSequence = async (person: string, { fileName }: HashedClip) => {
    this.calls.push(["upload", person, fileName]);
    return sequence({ id: "s", kind: "keypoints" });
  };
  createMeeting = async (name: string, models: string[]) => {
    this.calls.push(["meeting", name, models]);
    return { id: "m" };
  };
  addPerformer = async (...given: string[]) => void this.calls.push(["performer", ...given]);
  meeting = async (id: string) => ({ id });
}

function setUp(): { server: FakeServer; api: Api } {
  const server = new FakeServer();
  return { server, api: server as unknown as Api };
}

describe("isJson", () => {
  it.each([
    ["an object", '{"a": 1}', true],
    ["a list after white space", " \r\n[1]", true],
    ["a byte order mark first", "\uFEFF{", true],
    ["text", "dear diary", false],
    ["a clip", "\u0000\u0000\u0000 ftypisom{", false],
    ["nothing", "", false],
  ])("tells %s", async (_, text, expected) => {
    expect(await isJson(new Blob([text]))).toBe(expected);
  });
});

describe("animatablePeople", () => {
  it("has each person once, with their latest model, the latest first", async () => {
    const found = await animatablePeople(setUp().api);
    expect(found).toEqual([ADA, { personId: "b", name: "Bob", modelId: "b1", mine: false }]);
  });
});

describe("createKeypointsMeeting", () => {
  it("lends the motion to the person in a meeting of its own", async () => {
    const { server, api } = setUp();
    expect(await createKeypointsMeeting(api, ADA, KEYPOINTS, never)).toEqual({ id: "m" });
    expect(server.calls).toEqual([
      ["upload", "a", "wave.json"],
      ["meeting", "Ada by keypoints", []],
      ["performer", "m", "a2", "s"],
    ]);
  });

  it("sends no clip as keypoints", async () => {
    const { server, api } = setUp();
    const clip = new File(["\u0000\u0000\u0000 ftypisom"], "me.mp4");
    await expect(createKeypointsMeeting(api, ADA, clip, never)).rejects.toThrow("contains no keypoints");
    expect(server.calls).toEqual([]);
  });
});
