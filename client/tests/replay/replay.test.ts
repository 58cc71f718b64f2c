import { describe, expect, it } from "vitest";
import { Player, clockText } from "../../src/replay/player";
import { indexAt, poseAt, readText, readTrack, type Track } from "../../src/replay/tracks";
import type { PosePacket } from "../../src/transport/packets";
import { loadEnvironment } from "../../src/replay/renderer";
import type { Environment } from "../../src/api/types";

function records(...found: [number, string][]): ArrayBuffer {
  const parts = found.map(([at, text]) => {
    const data = new TextEncoder().encode(text);
    const bytes = new Uint8Array(6 + data.length);
    const view = new DataView(bytes.buffer);
    view.setUint32(0, at, true);
    view.setUint16(4, data.length, true);
    bytes.set(data, 6);
    return bytes;
  });
  return Uint8Array.from(parts.flatMap((part) => [...part])).buffer;
}

describe("a recording's tracks", () => {
  it("are read as they were written", () => {
    const track = readText(records([0, "hello"], [4_000_000_000, "günther"], [5, ""]));
    expect(track).toEqual({ times: [0, 4_000_000_000, 5], items: ["hello", "günther", ""] });
  });

  it("that break off are told", () => {
    expect(() => readText(records([0, "hello"]).slice(0, 9))).toThrow(RangeError);
    expect(() => readText(records([0, "hello"]).slice(0, 4))).toThrow(RangeError);
  });

  it("leave out what can't be read", () => {
    expect(readTrack(records([1, "a"], [2, "b"]), (data) => (data.byteLength ? null : 1)).items).toEqual([]);
  });

  it("say how somebody stood, also where nothing was kept for a while", () => {
    const [first, second] = [{ sequence: 1 }, { sequence: 2 }] as PosePacket[];
    const motion = { times: [100, 200], items: [first, second] } as Track<PosePacket>;
    expect([50, 199, 600, 80_000].map((ms) => poseAt(motion, ms))).toEqual([first, first, second, second]);
    expect(poseAt(undefined, 100)).toBeNull();
    expect(poseAt({ times: [], items: [] }, 100)).toBeNull();
    expect([99, 100, 150, 200, 999].map((ms) => indexAt(motion.times, ms))).toEqual([-1, 0, 0, 1, 1]);
  });
});

describe("the time of a replay", () => {
  function setUp() {
    const time = { ms: 5000 };
    return { time, player: new Player(10_000, () => time.ms) };
  }

  it("goes on while it plays, at its speed, and rests at the end", () => {
    const { time, player } = setUp();
    expect(player.ms).toBe(0);
    player.play();
    time.ms += 2000;
    expect(player.ms).toBe(2000);
    player.setSpeed(2);
    time.ms += 1000;
    expect(player.ms).toBe(4000);
    player.pause();
    time.ms += 9000;
    expect(player.ms).toBe(4000);
    player.play();
    time.ms += 9000;
    expect(player.ms).toBe(10_000);
    player.tick();
    expect(player.playing).toBe(false);
    player.play();
    expect(player.ms).toBe(0);
  });

  it("jumps, within the recording, and tells of each change", () => {
    const { player } = setUp();
    let told = 0;
    player.onChange = () => (told += 1);
    player.seek(99_999);
    expect(player.ms).toBe(10_000);
    player.seek(-5);
    expect(player.ms).toBe(0);
    expect(told).toBe(2);
    expect(clockText(75_900)).toBe("1:15");
  });
});

describe("the environment of a recording", () => {
  const place = (name: string, key: number): Environment => ({
    name, title: name, picture_url: null,
    light: { harmonics: [], key_direction: [0, 1, 0], key_colour: [key, key, key] },
  });
  const asked: string[] = [];
  const api = {
    environments: async () => [place("studio", 0), place("lobby", 1)],
    recordedEnvironment: async (id: string) => {
      asked.push(id);
      return place("own-7", 2);
    },
    file: async () => new Blob(),
  };

  it("is a place of the library, else the one that the host had brought along", async () => {
    expect((await loadEnvironment(api, "r1", "lobby")).light?.key_colour).toEqual([1, 1, 1]);
    expect(asked).toEqual([]);
    expect((await loadEnvironment(api, "r1", "own-7")).light?.key_colour).toEqual([2, 2, 2]);
    expect(asked).toEqual(["r1"]);
  });
});
