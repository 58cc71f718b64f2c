import { describe, expect, it } from "vitest";
import golden from "../../../tests/capture/expressions.json";
import { cropOf, mostCentral } from "../../src/landmarks/crops";
import {
  FACE,
  LEFT_HAND,
  RestingFaceEstimator,
  TYPICAL_RESTING_FACE,
  faceMeasures,
  faceNumbers,
  fingerCurls,
  restingFace,
  type Point,
} from "../../src/landmarks/expression";
import { ExpressionDetector, type ExpressionWorker, type ExpressionMessage, type PartPicture } from "../../src/landmarks/expressions";
import { LANDMARK_COUNT, type Landmarks } from "../../src/landmarks/landmarks";

/** The server's numbers; the test there tells how they are made anew. */
const faces = golden.faces.map((given) => {
  const points: Point[] = Array.from({ length: 478 }, () => [0, 0, 0]);
  for (const [i, point] of Object.entries(given)) points[Number(i)] = point as unknown as Point;
  return points;
});
const close = (found: readonly number[] | null, wanted: readonly number[]): void => {
  expect(found).toHaveLength(wanted.length);
  wanted.forEach((value, i) => expect(found?.[i]).toBeCloseTo(value, 6));
};

describe("expressions", () => {
  it("are measured as the server does", () => {
    const measures = faces.map((points) => faceMeasures(points) ?? []);
    measures.forEach((found, i) => close(found, golden.measures[i] ?? []));
    const rest = restingFace(measures);
    close(rest, golden.rest);
    measures.forEach((found, i) => close(faceNumbers(found, rest), golden.numbers[i] ?? []));
    golden.hands.forEach((hand, i) => close(fingerCurls(hand as unknown as Point[]), golden.curls[i] ?? []));
  });

  it("are not told of faces that are small or look away", () => {
    const [face = []] = faces;
    expect(faceMeasures(face.map(([x, y, z]): Point => [0.1 * x, 0.1 * y, 0.1 * z]))).toBeNull();
    const turned = face.map(([x, y, z]): Point => [0.5 * x - 0.87 * z, y, 0.87 * x + 0.5 * z]);
    expect(faceMeasures(turned)).toBeNull();
  });

  it("are told from a rest that is learnt: at first how they look then, mouth shut", () => {
    const finder = new RestingFaceEstimator();
    const [resting = [], talking = []] = golden.measures;
    const first = finder.update(talking, 0);
    close(first.slice(1, 5), talking.slice(1, 5));
    expect(first[0]).toBeCloseTo(TYPICAL_RESTING_FACE[0] ?? NaN, 2);
    for (let ms = 0; ms < 90_000; ms += 100) finder.update(resting, ms);
    close(finder.update(resting, 90_000), resting);
  });
});

function somebody(): Landmarks {
  const seen = {
    width: 640,
    height: 480,
    xy: new Float32Array(2 * LANDMARK_COUNT).fill(0.5),
    world: new Float32Array(3 * LANDMARK_COUNT),
    visibility: new Float32Array(LANDMARK_COUNT).fill(1),
  };
  seen.xy.set([0.4, 0.5], 2 * 7); // ears, 128 px apart
  seen.xy.set([0.6, 0.5], 2 * 8);
  return seen;
}

describe("mostCentral", () => {
  it("takes the hand that the square is about, of those that it shows", () => {
    const at = (x: number, y: number) => [{ x: x - 0.1, y }, { x: x + 0.1, y }];
    expect(mostCentral([at(0.9, 0.5), at(0.45, 0.55), at(0.2, 0.1)])).toBe(1);
    expect(mostCentral([])).toBe(-1);
  });
});

describe("cropOf", () => {
  it("holds a head with room about it, and hands of the size that goes with it", () => {
    expect(cropOf("face", somebody())).toEqual({ x: 179, y: 99, side: 282 });
    expect(cropOf("left_hand", somebody())?.side).toBe(Math.round(2 * 2.2 * 128));
  });

  it("looks for no hand that is hidden or outside of the picture", () => {
    const hidden = somebody();
    hidden.visibility[19] = 0.2;
    expect(cropOf("left_hand", hidden)).toBeNull();
    expect(cropOf("right_hand", hidden)).not.toBeNull();
    const outside = somebody();
    for (const i of [16, 18, 20, 22]) outside.xy[2 * i] = 1.2;
    expect(cropOf("right_hand", outside)).toBeNull();
  });
});

class FakeWorker implements ExpressionWorker {
  onmessage: ExpressionWorker["onmessage"] = null;
  pictures: PartPicture[] = [];
  postMessage = (picture: PartPicture): void => void this.pictures.push(picture);
  terminate = (): void => undefined;
  say = (answer: ExpressionMessage): void => this.onmessage?.({ data: answer } as MessageEvent<ExpressionMessage>);
}

const settled = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));

const FACE_SEEN = [1, 0, 0, 0, 0.5, 0.25, 0];
const HAND_SEEN = [0.25, 0, 1, 0.5, 0.75];

describe("ExpressionDetector", () => {
  function setUp() {
    const worker = new FakeWorker();
    const clock = { ms: 0 };
    const finder = new ExpressionDetector(async () => ({}) as ImageBitmap, () => clock.ms, worker);
    /** A picture of the body detector at `ms`; the part that is looked at, which takes `costMs`. */
    const offer = async (ms: number, costMs: number): Promise<string | undefined> => {
      const before = worker.pictures.length;
      clock.ms = ms;
      finder.offer(somebody(), ms);
      await settled();
      const asked = worker.pictures[before];
      clock.ms = ms + costMs;
      if (asked) worker.say({ kind: "found", part: asked.part, timeMs: ms, numbers: asked.part === "face" ? FACE_SEEN : HAND_SEEN, head: null });
      return asked?.part;
    };
    return { worker, finder, offer };
  }

  it("asks for nothing before the models are there, and for nothing that the server has none of", async () => {
    const { worker, offer } = setUp();
    expect(await offer(0, 5)).toBeUndefined();
    worker.say({ kind: "ready", parts: ["face"] });
    expect([await offer(100, 5), await offer(200, 5)]).toEqual(["face", "face"]);
  });

  it("looks at the face in two of three looks, and rests as long as a look takes", async () => {
    const { worker, offer } = setUp();
    worker.say({ kind: "ready", parts: ["face", "left_hand", "right_hand"] });
    const asked: (string | undefined)[] = [];
    for (let picture = 0; picture < 12; picture++) asked.push(await offer(33 * picture, 30));
    const looks = ["face", "left_hand", "face", "face", "right_hand", "face"];
    expect(asked).toEqual(looks.flatMap((part) => [part, undefined]));
  });

  it("leaves everything to a finder of bodies that is slow", async () => {
    const { worker, offer } = setUp();
    worker.say({ kind: "ready", parts: ["face"] });
    for (let picture = 0; picture < 30; picture++) await offer(300 * picture, 5);
    expect(await offer(9300, 5)).toBeUndefined();
  });

  it("tells what it saw for a moment, and of no more than it saw", async () => {
    const { worker, finder, offer } = setUp();
    worker.say({ kind: "ready", parts: ["face", "left_hand", "right_hand"] });
    expect(finder.at(0)).toBeNull();
    await offer(100, 5);
    expect(finder.at(150)).toMatchObject({ known: FACE });
    await offer(200, 5);
    const seen = finder.at(250);
    expect(seen?.known).toBe(FACE | LEFT_HAND);
    expect([...(seen?.values ?? [])]).toEqual([...FACE_SEEN, ...HAND_SEEN, 0, 0, 0, 0, 0]);
    // long at first, since nobody knows when the next look will be
    expect(finder.at(1650)?.known).toBe(LEFT_HAND);
    expect(finder.at(1750)).toBeNull();
  });

  it("tells the fingers of either hand", async () => {
    const { worker, finder, offer } = setUp();
    worker.say({ kind: "ready", parts: ["face", "left_hand", "right_hand"] });
    for (const ms of [100, 200, 300, 400, 500]) await offer(ms, 5);
    expect([...(finder.at(500)?.values ?? [])]).toEqual([...FACE_SEEN, ...HAND_SEEN, ...HAND_SEEN]);
  });

  it("holds what it saw for longer where it looks less often", async () => {
    const { worker, finder, offer } = setUp();
    worker.say({ kind: "ready", parts: ["face"] });
    await offer(0, 5);
    await offer(100, 5);
    expect([finder.at(390)?.known, finder.at(410)?.known]).toEqual([FACE, undefined]);
    await offer(500, 5);
    expect([finder.at(1290)?.known, finder.at(1310)?.known]).toEqual([FACE, undefined]);
  });
});
