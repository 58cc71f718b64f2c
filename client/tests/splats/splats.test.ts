import { describe, expect, it } from "vitest";
import { packSplats, shareWithin } from "../../src/splats/packed";
import { readSplats, type SplatFile } from "../../src/splats/file";
import { allocateOffsets, movedSplats, moveSplats } from "../../src/splats/moved";
import { withoutOwnHead } from "../../src/splats/ownHead";
import { contactShadows, screenHalfSize, screenPlace } from "../../src/splats/room";
import { transformedJoint, forwardKinematics, TRANSFORM } from "../../src/splats/skeleton";
import { allocateOrder, depthOrder, depthRows, depths, displaced } from "../../src/splats/sort";
import { loadSplats } from "../../src/api/splats";
import { RenderModeSelector } from "../../src/splats/renderMode";
import { fakeFetch } from "../fakes";

/**
 * A file of `count` splats on two joints; the n-th lies n cm up, whole, red, on joint n mod 2. Splats
 * `moved` go 2 cm up as the jaw opens, and a hundredth of that aside with the last number.
 */
function fileOf(count: number, light = 0, moved: readonly number[] = [], version = 6): ArrayBuffer {
  const movedBytes = version === 4 ? 28 * moved.length : 8 * shapesOf(version) + 7 * 2 * moved.length;
  const bytes = new ArrayBuffer(160 + 28 + 32 * count + movedBytes);
  const data = new DataView(bytes);
  [..."MNSP"].forEach((letter, i) => data.setUint8(i, letter.charCodeAt(0)));
  data.setUint16(4, version, true);
  data.setUint16(6, 2, true);
  data.setUint32(8, count, true);
  [0, 0, 0, 1, 655.35, 1, Math.log(0.01), 0].forEach((value, i) => data.setFloat32(12 + 4 * i, value, true));
  [0, 1, 0, 0, 2, 0].forEach((value, i) => data.setFloat32(160 + 4 * i, value, true));
  for (let i = 0; i < 27; i++) data.setFloat32(44 + 4 * i, light * i, true);
  [-1, 0].forEach((value, i) => data.setInt16(184 + 2 * i, value, true));
  for (let n = 0; n < count; n++) {
    const at = 188 + 32 * n;
    data.setUint16(at + 2, n, true);
    data.setUint8(at + 9, 255);
    // half a turn about z: x and y keep their variance
    data.setUint32(at + 10, (512 | (512 << 10) | (512 << 20) | (3 << 30)) >>> 0, true);
    data.setUint8(at + 7, 255);
    [255, 0, 0, 255].forEach((value, i) => data.setUint8(at + 14 + i, value));
    data.setUint8(at + 18, n % 2);
    data.setUint8(at + 22, 255);
    [0, 128, 0, 0, -127, 0].forEach((value, i) => data.setInt8(at + 26 + i, value));
  }
  (version === 4 ? writeEarlierMoved : writeMoved)(data, 188 + 32 * count, moved, version);
  return bytes;
}

/** Of version 5, which has none of the eyes, and of today. */
const shapesOf = (version: number): number => (version === 5 ? 15 : 17);

function writeMoved(data: DataView, at: number, moved: readonly number[], version: number): void {
  const shapes = shapesOf(version);
  data.setUint32(152, shapes, true);
  data.setUint32(156, 2 * moved.length, true);
  for (const e of [0, shapes - 1]) {
    data.setUint32(at + 8 * e, moved.length, true);
    data.setFloat32(at + 8 * e + 4, 0.02, true);
  }
  [...moved, ...moved].forEach((splat, i) => data.setUint32(at + 8 * shapes + 4 * i, splat, true));
  moved.forEach((_, i) => {
    const offsets = at + 8 * shapes + 8 * moved.length;
    data.setInt8(offsets + 3 * i + 1, 127);
    data.setInt8(offsets + 3 * (moved.length + i), -1);
  });
}

/** As version 4 has it: seven numbers, the last of which closes the whole right hand. */
function writeEarlierMoved(data: DataView, start: number, moved: readonly number[]): void {
  data.setUint32(152, moved.length, true);
  data.setFloat32(156, 0.02, true);
  moved.forEach((splat, i) => {
    data.setUint32(start + 28 * i, splat, true);
    data.setInt8(start + 28 * i + 4 + 1, 127);
    data.setInt8(start + 28 * i + 4 + 18, -1);
  });
}

describe("readSplats", () => {
  it("reads places, shapes, colours and bones", () => {
    const file = readSplats(fileOf(3));
    expect(file.count).toBe(3);
    expect([...file.positions.slice(6)]).toEqual([0, expect.closeTo(0.02, 6), 0]);
    const [xx, xy, xz, yy, yz, zz] = file.covariances;
    expect([xx, yy, zz]).toEqual([1e-4, 1, 1e-4].map((value) => expect.closeTo(value, 4)));
    for (const value of [xy, xz, yz]) expect(value).toBeCloseTo(0, 2);
    expect([...file.colours.slice(0, 3), file.opacities[0]]).toEqual([255, 0, 0, 255]);
    expect([...file.albedos.slice(0, 3), ...file.normals.slice(0, 3)]).toEqual([0, 128, 0, 0, -127, 0]);
    expect([...file.joints.slice(0, 8)]).toEqual([0, 0, 0, 0, 1, 0, 0, 0]);
    expect([...file.restJoints]).toEqual([0, 1, 0, 0, 2, 0]);
    expect([...file.parents]).toEqual([-1, 0]);
  });

  it("takes any beginning, made wider by the fourth root of what is left out", () => {
    const half = readSplats(fileOf(8), 0.5);
    expect(half.count).toBe(4);
    expect(half.covariances[3]).toBeCloseTo(Math.sqrt(2) * (readSplats(fileOf(8)).covariances[3] ?? 0), 5);
  });

  it("reads the light of the clip, where it is known", () => {
    expect(readSplats(fileOf(1)).light).toBeNull();
    expect([...(readSplats(fileOf(1, 0.5)).light ?? [])]).toEqual(Array.from({ length: 27 }, (_, i) => 0.5 * i));
  });

  it("moves a finger that is half bent by all of its in-between", () => {
    const shape = { splats: Uint32Array.of(0), offsets: Float32Array.of(1, 0, 0) };
    const nothing = { splats: new Uint32Array(0), offsets: new Float32Array(0) };
    const moved = movedSplats([...Array<typeof nothing>(26).fill(nothing), shape], 1);
    const offsets = allocateOffsets(1);
    const across = (curl: number) => {
      moveSplats(moved, [...Array<number>(16).fill(0), curl], offsets);
      return offsets[0];
    };
    expect([0, 0.5, 1].map(across)).toEqual([0, 1, 0]);
    expect(across(0.25)).toBeCloseTo(0.75);
  });

  it.each([6, 5])("reads which splats face and hands move, as far as they are drawn, of version %i", (version) => {
    const { moved } = readSplats(fileOf(8, 0, [1, 3, 6], version));
    expect([...moved.splats]).toEqual([1, 3, 6]);
    const offsets = allocateOffsets(4);
    moveSplats(moved, [0.5, ...Array<number>(15).fill(0), 1], offsets, 1);
    const [up, aside] = [0.01, -0.02 / 127].map((value) => expect.closeTo(value, 6));
    expect([...offsets.slice(4, 10)]).toEqual([aside, up, 0, 0, aside, up]);
    expect([...offsets.slice(0, 4)]).toEqual([0, 0, 0, 0]);
    expect([...readSplats(fileOf(8, 0, [1, 3, 6], version), 0.5).moved.splats]).toEqual([1, 3]);
  });

  it("reads files of whole hands, of which each finger takes an equal share", () => {
    const { moved } = readSplats(fileOf(8, 0, [1, 3, 6], 4));
    expect([...moved.splats]).toEqual([1, 3, 6]);
    const offsets = allocateOffsets(3);
    moveSplats(moved, [0.5, ...Array<number>(11).fill(0), 1, 1, 1, 1, 1], offsets);
    const [up, aside] = [0.01, -0.02 / 127].map((value) => expect.closeTo(value, 6));
    expect([...offsets.slice(4, 7)]).toEqual([aside, up, 0]);
    moveSplats(moved, [...Array<number>(16).fill(0), 1], offsets);
    expect([...offsets.slice(4, 7)]).toEqual([expect.closeTo(-0.004 / 127, 8), 0, 0]);
    expect([...readSplats(fileOf(8, 0, [1, 3, 6], 4), 0.5).moved.splats]).toEqual([1, 3]);
  });

  it("keeps splats apart that different numbers move", () => {
    const [up, aside] = [new Float32Array([0, 1, 0]), new Float32Array([2, 0, 0, 3, 0, 0])];
    const shapes = [{ splats: new Uint32Array([4]), offsets: up }, { splats: new Uint32Array([2, 4]), offsets: aside }];
    const moved = movedSplats(shapes, 6);
    expect([...moved.splats]).toEqual([2, 4]);
    const offsets = allocateOffsets(2).fill(9);
    moveSplats(moved, [1, 0.5], offsets);
    expect([...offsets.slice(0, 8)]).toEqual([1, 0, 0, 0, 1.5, 1, 0, 0]);
    expect(offsets[8]).toBe(9);
  });

  it("reads what is here of a beginning, as wide as if the rest were left out", () => {
    const bytes = fileOf(8, 0.5, [1, 3]);
    const beginning = readSplats(bytes.slice(0, 188 + 32 * 4 + 10), 1, true);
    const half = readSplats(bytes, 0.5);
    expect(beginning.count).toBe(4);
    expect(beginning.covariances).toEqual(half.covariances);
    expect(beginning.positions).toEqual(half.positions);
    expect(beginning.light).toEqual(half.light);
    expect(beginning.moved.splats).toHaveLength(0);
    expect(readSplats(bytes, 1, true).moved.splats).toHaveLength(2);
    expect(() => readSplats(new Uint8Array(188 + 32 * 9).fill(1).buffer, 1, true)).toThrow("must begin with MNSP");
  });

  it("says what is wrong with anything else", () => {
    expect(() => readSplats(new ArrayBuffer(3))).toThrow("must begin with MNSP, version 7; got less");
    expect(() => readSplats(fileOf(2).slice(0, -1))).toThrow("2 splats must have 388 bytes; got 387");
    expect(() => readSplats(fileOf(2, 0, [1]).slice(0, -1))).toThrow("2 splats must have 402 bytes; got 401");
  });
});

const BONES = { restJoints: new Float32Array([0, 1, 0, 0, 2, 0]), parents: new Int16Array([-1, 0]) };
const REST = [1, 0, 0, 0, 1, 0, 0, 0];
const QUARTER_Z = [Math.SQRT1_2, 0, 0, Math.SQRT1_2];

function posed(pelvis: number[], turns: number[]): Float32Array {
  const transforms = new Float32Array(2 * TRANSFORM);
  forwardKinematics(BONES, pelvis, turns, transforms);
  return transforms;
}

describe("forwardKinematics", () => {
  it("leaves everything where it was at rest", () => {
    const [a, b] = [posed([0, 1, 0], REST), [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]];
    expect([...a]).toEqual([...b, ...b]);
  });

  it("turns children with their parents, about where their parents carried them", () => {
    const transforms = posed([5, 1, 0], [...QUARTER_Z, ...QUARTER_Z]);
    // the child sits a metre above the pelvis at rest, so a quarter turn puts it beside
    expect(transformedJoint(transforms, TRANSFORM, BONES.restJoints, 1)).toEqual(
      [4, 1, 0].map((value) => expect.closeTo(value, 5)),
    );
    // what is bound to the child has turned twice
    expect([...transforms.slice(TRANSFORM, TRANSFORM + 3)]).toEqual([-1, 0, 0].map((v) => expect.closeTo(v, 5)));
  });
});

describe("depthOrder", () => {
  it("sorts by rising depth and leaves out what is behind", () => {
    const order = allocateOrder(5);
    expect(depthOrder(new Float32Array([3, 1, -2, 2, 0.01]), order)).toBe(3);
    expect([...order.slice(0, 3)]).toEqual([1, 3, 0]);
  });

  it("agrees with a comparison sort to a bin's width, and keeps equals in their order", () => {
    const depth = Float32Array.from({ length: 5000 }, (_, i) => 2 + ((i * 7919) % 5000) / 5000);
    const order = allocateOrder(depth.length);
    const count = depthOrder(depth, order);
    expect(new Set(order.slice(0, count)).size).toBe(5000);
    for (let n = 1; n < count; n++) {
      const [before = 0, after = 0] = [depth[order[n - 1] ?? 0], depth[order[n] ?? 0]];
      expect(after - before).toBeGreaterThan(-1 / 4096 - 1e-6);
    }
    depthOrder(new Float32Array(4).fill(1), order);
    expect([...order.slice(0, 4)]).toEqual([0, 1, 2, 3]);
  });

  it("has nothing to sort where everything is behind", () => {
    expect(depthOrder(new Float32Array([-1, 0]), allocateOrder(2))).toBe(0);
  });
});

describe("depths", () => {
  it("are those of the skinned places in the camera", () => {
    const cast = packSplats([readSplats(fileOf(4))]);
    const transforms = posed([0, 1, 3], [...REST.slice(0, 4), ...QUARTER_Z]);
    const depth = new Float32Array(4);
    // looks along -z from z = 10: depth is 10 - z
    const camera = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 10];
    depths(cast.skinned, depthRows(transforms, camera), depth);
    expect([...depth]).toEqual([7, 7, 7, 7].map((value) => expect.closeTo(value, 5)));
  });

  it("are nothing for what is left out of a person, whoever comes after", () => {
    const cast = packSplats([readSplats(fileOf(3)), readSplats(fileOf(2))]);
    const rows = new Float32Array(4 * cast.joints);
    for (let joint = 0; joint < cast.joints; joint++) rows[4 * joint + 3] = 5;
    const depth = new Float32Array(5).fill(9);
    depths(cast.skinned, rows, depth, [1, 2]);
    expect([...depth]).toEqual([5, 0, 0, 5, 5]);
    const order = allocateOrder(5);
    expect(depthOrder(depth, order)).toBe(3);
    expect([...order.slice(0, 3)]).toEqual([0, 3, 4]);
  });
});

describe("displaced", () => {
  it("puts each splat where its expression moves it, whoever it belongs to", () => {
    const cast = packSplats([readSplats(fileOf(3, 0, [2])), readSplats(fileOf(2, 0, [0, 1]))]);
    const offsets = allocateOffsets(cast.moved);
    offsets.set([1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9, 0]);
    const moved = displaced(cast.skinned, offsets).positions;
    const by = Array.from(moved, (value, i) => Math.round(value - (cast.skinned.positions[i] ?? 0)));
    expect(by).toEqual([0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
  });
});

describe("packSplats", () => {
  it("tells of each splat that moves where its offset is found, whoever it belongs to", () => {
    const cast = packSplats([readSplats(fileOf(3, 0, [2])), readSplats(fileOf(2, 0, [0, 1]))]);
    expect(cast.moved).toBe(3);
    const owners = [0, 1, 2, 3, 4].map((splat) => cast.table[16 * splat + 15] ?? 0);
    expect(owners.map((packed) => packed & 255)).toEqual([0, 0, 0, 1, 1]);
    expect(owners.map((packed) => packed >> 8)).toEqual([0, 0, 1, 2, 3]);
  });

  it("puts people one after the other, each on joints of their own", () => {
    const cast = packSplats([readSplats(fileOf(2)), readSplats(fileOf(3))]);
    expect([cast.count, cast.joints]).toEqual([5, 4]);
    expect([0, 1, 2, 3, 4].map((i) => cast.skinned.joints[4 * i])).toEqual([0, 1, 2, 3, 2]);
    expect([0, 1, 2, 3, 4].map((i) => (cast.table[16 * i + 3] ?? 0) & 0xffff)).toEqual([0, 1, 2, 3, 2]);
    const floats = new Float32Array(cast.table.buffer);
    expect(floats[16 * 4 + 1]).toBeCloseTo(0.02, 6);
    // red, whole; green without light, opaque; facing down; the second of them
    expect([...cast.table.slice(16 * 4 + 12, 16 * 5)]).toEqual([0xff0000ff, 0xff008000, 0x008100, 1]);
  });

  it("shares a budget", () => {
    expect(shareWithin([10_000, 10_000])).toBe(1);
    expect(shareWithin([30_000, 90_000])).toBe(0.5);
    expect(shareWithin([])).toBe(1);
  });
});

describe("contactShadows", () => {
  const body = (lift: number): readonly (readonly number[])[] => {
    const parents = new Int16Array(9).fill(0);
    parents[0] = -1;
    const restJoints = new Float32Array(27);
    const person: Pick<SplatFile, "restJoints" | "parents"> = { restJoints, parents };
    const transforms = new Float32Array(9 * TRANSFORM);
    forwardKinematics(person, [2, lift, 1], Array.from({ length: 36 }, (_, i) => (i % 4 === 0 ? 1 : 0)), transforms);
    return contactShadows(person, transforms, 0);
  };

  it("lie under both ankles and vanish as they rise", () => {
    expect(body(0)).toEqual([[2, 1, 0.22, 0.45], [2, 1, 0.22, 0.45]]);
    expect(body(0.35)[0]).toEqual([2, 1, expect.closeTo(0.44, 5), expect.closeTo(0, 6)]);
  });
});

describe("screenHalfSize", () => {
  it("keep a screen's shape, as wide or as high as there is room", () => {
    expect(screenHalfSize(1600, 800)).toEqual([1.3, 0.65]);
    expect(screenHalfSize(900, 1600)).toEqual([expect.closeTo(0.421875, 6), 0.75]);
    expect(screenHalfSize(0, 0).every(Number.isFinite)).toBe(true);
  });
});

describe("RenderModeSelector", () => {
  it("lets a quick device draw and a slow one be served", () => {
    const chooser = new RenderModeSelector();
    expect(chooser.mode).toBe("server");
    chooser.setTrialFps(300);
    expect(chooser.mode).toBe("local");
    chooser.setTrialFps(12);
    expect(chooser.mode).toBe("server");
  });

  it("gives way after some seconds that are slow at the smallest size, until another cast", () => {
    const chooser = new RenderModeSelector();
    chooser.setTrialFps(100);
    for (let second = 0; second < 10; second++) chooser.observe(5, false);
    for (let second = 0; second < 3; second++) chooser.observe(5, true);
    expect(chooser.mode).toBe("local");
    chooser.observe(5, true);
    expect(chooser.mode).toBe("server");
    chooser.setTrialFps(100);
    expect(chooser.mode).toBe("local");
  });

  it("does as the viewer says, whatever it measured", () => {
    const chooser = new RenderModeSelector();
    chooser.choose("local");
    for (let second = 0; second < 10; second++) chooser.observe(1, true);
    expect(chooser.mode).toBe("local");
    chooser.setTrialFps(500);
    chooser.choose("server");
    expect(chooser.mode).toBe("server");
  });
});

describe("loadSplats", () => {
  it("shows the seat's token, and draws nobody of whom there is no file", async () => {
    const { request, calls } = fakeFetch(({ path }) => {
      if (path.includes("field")) return new Response(null, { status: 204 });
      return path.includes("gone") ? new Response("{}", { status: 404 }) : new Response(fileOf(1));
    });
    expect((await loadSplats("m", "seat", request))?.byteLength).toBe(356);
    expect(calls[0]).toMatchObject({ path: "/v1/models/m/files/viewer.splats", token: "Bearer seat" });
    expect(await loadSplats("field", "seat", request)).toBeNull();
    expect(await loadSplats("gone", "seat", request)).toBeNull();
  });

  it("tells of refusals, and takes nothing that is too large", async () => {
    const refused = fakeFetch(() => new Response("{}", { status: 403 }));
    await expect(loadSplats("m", "seat", refused.request)).rejects.toMatchObject({ status: 403 });
    const large = fakeFetch(() => new Response("x", { headers: { "Content-Length": "9000000" } }));
    expect(await loadSplats("m", "seat", large.request)).toBeNull();
    const endless = fakeFetch(() => new Response(new Uint8Array(9_000_000)));
    expect(await loadSplats("m", "seat", endless.request)).toBeNull();
  });

  it("tells the beginning of a large file once, before the rest is here", async () => {
    const whole = Uint8Array.from({ length: 500_000 }, (_, i) => i % 251);
    let at = 0;
    const body = new ReadableStream<Uint8Array>({
      pull(controller) {
        if (at >= whole.length) return controller.close();
        controller.enqueue(whole.slice(at, (at += 100_000)));
      },
    });
    const told: ArrayBuffer[] = [];
    const { request } = fakeFetch(() => new Response(body));
    const all = await loadSplats("m", "seat", request, (bytes) => void told.push(bytes));
    expect(told.map((bytes) => bytes.byteLength)).toEqual([100_000]);
    const same = (bytes: ArrayBuffer | null | undefined): boolean =>
      new Uint8Array(bytes ?? new ArrayBuffer(0)).every((byte, i) => byte === whole[i]);
    expect(all?.byteLength).toBe(whole.length);
    expect([same(told[0]), same(all)]).toEqual([true, true]);
  });

  it("tells of a line that breaks on the way", async () => {
    const body = new ReadableStream<Uint8Array>({ pull: (controller) => controller.error(new TypeError("gone")) });
    const { request } = fakeFetch(() => new Response(body));
    await expect(loadSplats("m", "seat", request)).rejects.toMatchObject({ title: "The server does not answer" });
  });
});

describe("withoutOwnHead", () => {
  const joints = 24;
  const standing = { restJoints: new Float32Array(3 * joints), parents: new Int16Array(joints).map((_, joint) => joint - 1) };
  standing.restJoints.set([0, 1.5, 0], 3 * 15);

  /** Everybody unturned, at x. */
  function transforms(...xs: number[]): Float32Array {
    const out = new Float32Array(TRANSFORM * joints * xs.length);
    xs.forEach((x, person) => {
      for (let joint = 0; joint < joints; joint++) out.set([1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0], TRANSFORM * (joints * person + joint));
    });
    return out;
  }

  it("leaves out whoever's eyes one looks through, and nobody else", () => {
    const people = [standing, standing];
    const two = transforms(0, 2);
    expect(withoutOwnHead(people, two, [2, 1.55, 0.3], [700, 900])).toEqual([700, 0]);
    expect(withoutOwnHead(people, two, [2, 1.55, 0.8], [700, 900])).toEqual([700, 900]);
    expect(withoutOwnHead(people, two, [0, 0.9, 0], [])).toEqual([Infinity, Infinity]);
  });
});

describe("screenPlace", () => {
  it("is behind everybody, facing the viewer", () => {
    const view = { target: [1, 1.3, 2], azimuth_rad: Math.PI / 2, elevation_rad: 0, distance_m: 3, width_m: 1, depth_m: 0.6, narrow: null } as const;
    expect(screenPlace(view)).toEqual({ centre: [-1.5, 1.72, 2].map((value) => expect.closeTo(value, 6)), azimuthRad: Math.PI / 2 });
  });
});
