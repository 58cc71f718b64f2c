import { beforeEach, describe, expect, it, vi } from "vitest";
import { SpatialAudio, rotated } from "../../src/meeting/spatialAudio";

class Param {
  value = 0;
  setTargetAtTime(to: number): void {
    this.value = to;
  }
}

class Node {
  positionX = new Param();
  positionY = new Param();
  positionZ = new Param();
  forwardX = new Param();
  forwardY = new Param();
  forwardZ = new Param();
  upX = new Param();
  upY = new Param();
  upZ = new Param();
  stream = {};
  panningModel = "";
  connected = 0;
  connect(to: Node): Node {
    this.connected += 1;
    return to;
  }
  disconnect(): void {
    this.connected = 0;
  }
  get place(): number[] {
    return [this.positionX.value, this.positionY.value, this.positionZ.value];
  }
}

class FakeContext {
  currentTime = 1;
  state = "suspended";
  listener = new Node();
  panners: Node[] = [];
  sources: Node[] = [];
  createMediaStreamDestination = (): Node => new Node();
  createMediaStreamSource = (): Node => (this.sources.push(new Node()), this.sources.at(-1)!);
  createPanner = (): Node => (this.panners.push(new Node()), this.panners.at(-1)!);
  resume = async (): Promise<void> => void (this.state = "running");
  close = async (): Promise<void> => void (this.state = "closed");
}

function setUp() {
  const context = new FakeContext();
  return { context, hearing: new SpatialAudio(context as unknown as AudioContext) };
}

const BO = { memberId: "bo", stream: {} as MediaStream };
const CY = { memberId: "cy", stream: {} as MediaStream };
/** Looks along +x from (1, 2, 3): OpenCV's z forward turned by +90 degrees about y. */
const EARS = { position: [1, 2, 3], wxyz: [Math.SQRT1_2, 0, Math.SQRT1_2, 0] } as const;

describe("SpatialAudio", () => {
  beforeEach(() => {
    vi.stubGlobal("Audio", class {});
  });

  it("puts each voice where its speaker stands, and others before the listener", () => {
    const { context, hearing } = setUp();
    hearing.setVoices(new Map([[0, BO], [3, CY]]));
    hearing.setPositions(EARS, (id) => (id === "bo" ? [4, 1.6, -2] : null));
    expect(context.panners.map(({ panningModel }) => panningModel)).toEqual(["HRTF", "HRTF"]);
    expect(context.panners[0]?.place).toEqual([4, 1.6, -2]);
    const [x, y, z] = context.panners[1]?.place ?? [];
    expect([x, y, z].map((v) => Math.round((v ?? 0) * 1e6) / 1e6)).toEqual([2, 2, 3]);
    const { listener } = context;
    expect(listener.place).toEqual([1, 2, 3]);
    expect(listener.forwardX.value).toBeCloseTo(1);
    expect(listener.forwardZ.value).toBeCloseTo(0);
  });

  it("keeps a track that another speaks in, and lets go of what is over", () => {
    const { context, hearing } = setUp();
    hearing.setVoices(new Map([[0, BO], [1, CY]]));
    hearing.setVoices(new Map([[0, { ...BO, memberId: "dee" }]]));
    expect(context.sources.map(({ connected }) => connected)).toEqual([1, 0]);
    hearing.setPositions(EARS, (id) => (id === "dee" ? [7, 0, 0] : [0, 0, 0]));
    expect(context.panners[0]?.place).toEqual([7, 0, 0]);
    hearing.close();
    expect(context.state).toBe("closed");
    expect(context.sources.every(({ connected }) => connected === 0)).toBe(true);
  });

  it("starts with a touch", async () => {
    const { context, hearing } = setUp();
    await hearing.resume();
    expect(context.state).toBe("running");
  });

  it("turns by quaternions", () => {
    const about = [Math.cos(0.25), 0, 0, Math.sin(0.25)] as const;
    const [x, y, z] = rotated(about, [1, 0, 0]);
    expect([x, y, z].map((v) => v.toFixed(6))).toEqual([Math.cos(0.5).toFixed(6), Math.sin(0.5).toFixed(6), "0.000000"]);
  });
});
