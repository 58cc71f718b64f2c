import { afterEach, beforeEach, describe, expect, it, vi, type Mock } from "vitest";
import type { Api } from "../../src/api/api";
import { LocalRendering } from "../../src/drawing/localRendering";
import type { RenderStatus } from "../../src/splats/renderMode";
import type { Meeting } from "../../src/api/types";
import type { CameraPose } from "../../src/viewpoint/viewpoint";
import { FRONT } from "../viewpoint/front";
import { eventually } from "../waiting";

// what needs a graphics card and a worker
const rooms = vi.hoisted(() => [] as Record<string, unknown>[]);
vi.mock("../../src/splats/localRoom", () => ({
  LocalRoom: class {
    loaded = false;
    drawable = false;
    obstacle = null;
    counts = [45_000];
    pelvisPositions = [[0, 1, 1.5]];
    onFinished = (_tookMs: number): void => undefined;
    draw = vi.fn(() => true);
    setEnvironment = vi.fn();
    setScreen = vi.fn();
    placeScreen = vi.fn();
    setPerformers = vi.fn(async () => undefined);
    drop = vi.fn();
    trialFps = (...[, , , kept]: [unknown, unknown, unknown, number[]]): number => 600_000 / (kept[0] ?? 1);
    onLoaded = (): void => undefined;
    onUnknownPerformers = (): void => undefined;
    close = vi.fn();
    constructor() {
      rooms.push(this as unknown as Record<string, unknown>);
    }
  },
}));

const STUDIO = { name: "studio", title: "Studio", picture_url: null, light: null };
const CAMERA: CameraPose = { position: [0, 1, 2], wxyz: [1, 0, 0, 0] };
const SIZE = { width: 512, height: 512 };

function drawing(place: () => Promise<unknown> = async () => STUDIO) {
  const told: RenderStatus[] = [];
  const onUnknownPerformers = vi.fn();
  const asked = vi.fn(place);
  const meeting = { id: "m", environment: "studio", performers: [], viewpoint: FRONT } as unknown as Meeting;
  const local = new LocalRendering({ environment: asked } as unknown as Api, meeting, {
    onModeChange: (one) => told.push(one),
    onShownChange: () => undefined,
    onUnknownPerformers: onUnknownPerformers,
    onPose: () => undefined,
    trialView: () => ({ camera: CAMERA, size: SIZE }),
    aspect: () => 1,
  });
  return { local, told, asked, onUnknownPerformers };
}

/** The page's picture is this device's to draw: everything is here, and its trial was fast. */
async function ready() {
  const made = drawing();
  made.local.token = "seat";
  made.local.begin();
  const room = rooms.at(-1) as {
    loaded: boolean;
    drawable: boolean;
    onLoaded(): void;
    onUnknownPerformers(): void;
    onFinished(tookMs: number): void;
    draw: Mock;
  };
  await eventually(() => expect(made.told.length).toBeGreaterThan(0));
  room.loaded = true;
  room.onLoaded();
  return { ...made, room };
}

describe("LocalRendering", () => {
  beforeEach(() => {
    vi.stubGlobal("document", { createElement: () => ({ classList: { toggle: vi.fn() } }) });
  });
  afterEach(() => {
    vi.unstubAllGlobals();
    vi.useRealTimers();
    rooms.length = 0;
  });

  it("asks for a place once, and anew where it was refused", async () => {
    const refused = vi.fn().mockRejectedValueOnce(new Error("gone")).mockResolvedValue(STUDIO);
    const { local, asked } = drawing(refused);
    await local.showEnvironment("studio");
    expect(asked).not.toHaveBeenCalled(); // nobody without a seat is shown it
    local.token = "seat";
    await local.showEnvironment("studio");
    await local.showEnvironment("studio");
    await local.showEnvironment("studio");
    expect(asked).toHaveBeenCalledTimes(2);
  });

  it("draws once people and place are here and a trial was fast, unless the viewer has the server draw", async () => {
    const { local } = await ready();
    expect(local.ready).toBe(true);
    local.chooseMode("server");
    expect(local.ready).toBe(false);
  });

  it("draws as many splats as the trial says, and gives way only once it draws the fewest too slowly", async () => {
    const { local, room } = await ready();
    const kept = (): number[] => {
      local.draw(CAMERA, SIZE, false);
      return room.draw.mock.calls.at(-1)?.[4] as number[];
    };
    expect(kept()).toEqual([10_000]);
    for (let second = 0; second < 10; second++) local.observeSpeed(5, true);
    expect(local.ready).toBe(true);
    for (let picture = 0; picture < 60; picture++) room.onFinished(90);
    for (let picture = 0; picture < 30; picture++) kept(); // a few less with each picture
    expect(kept()).toEqual([5_000]);
    for (let second = 0; second < 4; second++) local.observeSpeed(5, true);
    expect(local.ready).toBe(false);
  });

  it("leaves the picture to the server while nobody's poses come", async () => {
    const { local, room } = await ready();
    expect(local.idle).toBe(true);
    room.drawable = true;
    expect(local.idle).toBe(false);
  });

  it("says that the server draws alone after four seconds of pictures in place of poses", async () => {
    const { local, told } = await ready();
    for (let second = 0; second < 3; second++) local.observeSecond(30);
    expect(told.at(-1)?.obstacle).toBeNull();
    local.observeSecond(30);
    expect(told.at(-1)?.obstacle).toBe("This server does not let pages render the room");
    local.showLocal(true);
    expect(told.at(-1)).toMatchObject({ mode: "local", obstacle: null });
  });

  it("asks who the strangers are once a second at most", async () => {
    vi.useFakeTimers({ toFake: ["performance"] });
    const { room, onUnknownPerformers } = await ready();
    room.onUnknownPerformers();
    room.onUnknownPerformers();
    expect(onUnknownPerformers).toHaveBeenCalledTimes(1);
    vi.advanceTimersByTime(1001);
    room.onUnknownPerformers();
    expect(onUnknownPerformers).toHaveBeenCalledTimes(2);
  });

  it("draws for a headset at once, and closes its room with the visit", () => {
    const { local } = drawing();
    local.beginHeadset({} as HTMLCanvasElement, CAMERA, SIZE);
    expect(local.ready).toBe(true);
    local.endHeadset();
    expect(local.ready).toBe(false);
    expect((rooms[0] as { close: unknown }).close).toHaveBeenCalledTimes(1);
  });
});
