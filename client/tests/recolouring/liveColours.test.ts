import { describe, expect, it } from "vitest";
import { Footprints } from "../../src/recolouring/footprints";
import { hiddenByBody, hiddenByLimbs, limbSplats } from "../../src/recolouring/hidden";
import { LiveColours } from "../../src/recolouring/liveColours";
import { nearest } from "../../src/recolouring/neighbours";
import { PICTURE_PX } from "../../src/look/cutOut";
import { cutOutPicture, type CutOutPicture } from "../../src/recolouring/pictureReader";
import { ProjectedSplats, type Lens } from "../../src/recolouring/projected";
import type { DrawsPosed, Posed } from "../../src/recolouring/webcamView";
import { CHEST } from "../../src/splats/laid";
import { depthOrder } from "../../src/splats/sort";
import { person, poseOf, wall } from "./people";

const SIDE = 48;
/** 48 px show 24 cm of what is a metre away. */
const LENS: Lens = [200, 200, SIDE / 2, SIDE / 2];

function picture(rgb: readonly number[], known: (x: number, y: number) => boolean = () => true): CutOutPicture {
  return striped(() => rgb, known);
}

/** Each column in a colour of its own. */
function striped(rgbOf: (x: number) => readonly number[], known: (x: number, y: number) => boolean = () => true): CutOutPicture {
  const pixels = Array.from({ length: SIDE * SIDE }, (_, i) => i);
  return {
    side: SIDE,
    rgb: Float32Array.from(pixels.flatMap((i) => rgbOf(i % SIDE))),
    known: Float32Array.from(pixels, (i) => (known(i % SIDE, Math.floor(i / SIDE)) ? 1 : 0)),
  };
}

/** Red, green and blue of splat `i`, of 511ths. */
function changeOf(changes: Uint32Array, i: number): number[] {
  return [22, 12, 2].map((shift) => (((changes[i] ?? 0) << shift) >> 22) / 511);
}

/** `colours` after a second of the same picture. */
function played(colours: LiveColours, seen: CutOutPicture, fromS = 0): Uint32Array {
  for (let n = 0; n < 15; n++) colours.see(seen, poseOf(1, 1000 * fromS + (1000 * n) / 15), LENS);
  return colours.changesAt(fromS + 14 / 15);
}

describe("LiveColours", () => {
  const places = [...wall(20), ...wall(20, -0.2)];
  const [front, back] = [10 * 20 + 10, 400 + 10 * 20 + 10];

  /** A broad stripe of new colours on somebody who is as grey as they were. */
  const seen = striped((x) => (x >= 20 && x < 30 ? [0.7, 0.4, 0.1] : [0.4, 0.4, 0.4]));

  it("gives what the webcam sees the colour of the picture, and what lies behind its exposure alone", () => {
    const changes = played(new LiveColours(person(places), SIDE), seen);
    const [red = 0, green = 0, blue = 0] = changeOf(changes, front);
    expect(red).toBeCloseTo(0.3, 1);
    expect(green).toBeCloseTo(0, 1);
    expect(blue).toBeCloseTo(-0.3, 1);
    // a quarter of the wall is redder by three quarters
    expect(changeOf(changes, back)[0]).toBeCloseTo(0.08, 1);
  });

  it("leaves a colour alone from which coding may have led the picture astray", () => {
    const noisy = striped((x) => (x % 2 === 0 ? [0.44, 0.4, 0.4] : [0.36, 0.4, 0.4]));
    const changes = played(new LiveColours(person(places), SIDE), noisy);
    for (let i = 0; i < 800; i++) expect(Math.abs(changeOf(changes, i)[0]!)).toBeLessThan(0.005);
  });

  it("learns nothing from pixels that are not known", () => {
    const changes = played(new LiveColours(person(places), SIDE), picture([0.7, 0.4, 0.2], () => false));
    expect(Math.max(...changes)).toBe(0);
  });

  it("keeps a colour that is hidden for a while, then eases to the trained one", () => {
    const colours = new LiveColours(person(places), SIDE);
    played(colours, seen);
    const redAt = (timeS: number): number => changeOf(colours.changesAt(timeS), front)[0] ?? 0;
    expect(redAt(2.3)).toBeCloseTo(redAt(1), 2);
    expect(redAt(3.3)).toBeLessThan(0.8 * redAt(1));
    expect(redAt(6)).toBeLessThan(0.5 * redAt(1));
  });
});

describe("a laid picture", () => {
  const [front, back] = [10 * 20 + 10, 400 + 10 * 20 + 10];
  const FINE = 2 * SIDE;
  /** All of it known; each column as bright as it is told, of 255. */
  const fine = (greyOf: (x: number) => number) => ({
    side: FINE,
    rgba: Uint8ClampedArray.from({ length: 4 * FINE * FINE }, (_, at) => greyOf((at >> 2) % FINE)),
    known: new Uint8Array(FINE * FINE).fill(1),
  });
  const shareOf = (places: Uint32Array, i: number): number => (places[i] ?? 0) >>> 24;
  /** What draws everybody as one grey, and what it was told to draw. */
  const grey = (value: number): DrawsPosed & { told: Posed[] } => {
    const told: Posed[] = [];
    const draw = (posed: Posed, _: Lens, side: number): Uint8Array => {
      told.push(posed);
      return Uint8Array.from({ length: 4 * side * side }, (_, at) => (at % 4 === 3 ? 255 : 255 * value));
    };
    return { draw, told };
  };
  const stripes = (x: number): number => (x % 4 < 2 ? 82 : 122);

  it("is as much brighter or darker as the picture is than the splats in their live colours", () => {
    const colours = new LiveColours(person(wall(20), CHEST), SIDE);
    played(colours, picture([0.4, 0.4, 0.4]));
    const { detail, focalPx, webcam } = colours.laidPicture(fine(stripes), grey(0.4));
    const red = (x: number): number => ((detail[FINE * SIDE + x] ?? 0) & 1023) / 255;
    const [dark, bright] = [red(SIDE), red(SIDE + 2)];
    expect(dark).toBeCloseTo((82 / 255 + 0.04) / 0.44, 2);
    expect(bright).toBeCloseTo((122 / 255 + 0.04) / 0.44, 2);
    expect(focalPx).toBe(400);
    expect(webcam.map((m) => m + 0)).toEqual([0, 0, 1]);
  });

  it("is found beside what is shown: every splat that is drawn, in its live colour", () => {
    const colours = new LiveColours(person([...wall(20), [5, 0, 0]]), SIDE);
    const changes = played(colours, picture([0.7, 0.4, 0.2]));
    const view = grey(0.4);
    colours.laidPicture(fine(stripes), view);
    expect(view.told[0]?.changes).toEqual(changes);
    expect(view.told[0]?.count).toBe(400);
    expect(new Set(view.told[0]?.order.subarray(0, 400)).has(400)).toBe(false);
  });

  it("lies where the splats are in it that are seen", () => {
    const colours = new LiveColours(person([...wall(20), ...wall(20, -0.2)]), SIDE);
    played(colours, picture([0.4, 0.4, 0.4]));
    const { places } = colours.laidPicture(fine(stripes), grey(0.4));
    // half a centimetre right of the middle and above it: a pixel of the small picture
    const at = ((places[front] ?? 0) & 4095) * (PICTURE_PX / 4095);
    expect(at).toBeCloseTo(2 * (SIDE / 2 + 1), 0);
    expect(shareOf(places, front)).toBe(255);
    expect(shareOf(places, back)).toBe(0);
  });

  it("fades where the webcam sees a splat no longer, in a tenth of a second", () => {
    const colours = new LiveColours(person(wall(20)), SIDE);
    played(colours, picture([0.4, 0.4, 0.4]));
    const half = picture([0.4, 0.4, 0.4], (x) => x < SIDE / 2 + 3);
    const shares = [0.95, 0.98, 1.5].map((timeS) => {
      colours.see(half, poseOf(1, 1000 * timeS), LENS);
      colours.changesAt(timeS);
      return shareOf(colours.laidPicture(fine(stripes), grey(0.4)).places, front + 3);
    });
    expect(shares[0]).toBeLessThan(255);
    expect(shares[0]).toBeGreaterThan(shares[1]!);
    expect(shares[1]).toBeGreaterThan(shares[2]!);
  });
});

describe("Footprints", () => {
  it("share each pixel's light: what they show and let through is all of it", () => {
    const splats = new ProjectedSplats(person([...wall(10), ...wall(10, -0.1)]));
    splats.place(poseOf(1), LENS, SIDE);
    const footprints = new Footprints(200, SIDE);
    const order = new Uint32Array(200);
    const count = depthOrder(splats.depth, order);
    expect(count).toBe(200);
    expect(order[0]).toBeLessThan(100);
    footprints.fill(splats, order, count);
    const sums = footprints.through.slice();
    for (let at = 0; at < (footprints.starts[count] ?? 0); at++) sums[footprints.pixels[at]!]! += footprints.weights[at]!;
    for (const sum of sums) expect(sum).toBeCloseTo(1, 4);
    expect(footprints.through[24 * SIDE + 24]).toBeLessThan(0.1);
  });

  it("are nowhere for who is behind the webcam or beside its picture", () => {
    const splats = new ProjectedSplats(person([[0, 0, 2], [1, 0, 0], [0, 0, 0]]));
    splats.place(poseOf(1), LENS, SIDE);
    expect([...splats.depth].map((depth) => depth > 0)).toEqual([false, false, true]);
    expect([splats.x[2], splats.y[2]]).toEqual([24, 24]);
  });
});

describe("hiddenByLimbs", () => {
  it("names what is behind a hand or just beside it, and not the hand", () => {
    const body = person([...wall(20), [0, 0, 0.1]], 22);
    body.joints.fill(0, 0, 4 * 400);
    const limbs = limbSplats(body);
    expect([limbs[0], limbs[400]]).toEqual([0, 1]);
    const splats = new ProjectedSplats(body);
    splats.place(poseOf(1), LENS, SIDE);
    const hidden = hiddenByLimbs(splats, limbs, SIDE, LENS[0]);
    expect([hidden[10 * 20 + 10], hidden[0], hidden[400]]).toEqual([1, 0, 0]);
    expect(hiddenByLimbs(splats, new Uint8Array(401), SIDE, LENS[0]).some(Boolean)).toBe(false);
  });
});

describe("hiddenByBody", () => {
  it("names what lies through the body, and not what lies just under its surface", () => {
    const splats = new ProjectedSplats(person([[0, 0, 0.22], [0, 0, 0], [0, 0, 0.12], [0.2, 0, 0]]));
    splats.place(poseOf(1), LENS, SIDE);
    expect([...hiddenByBody(splats, new Uint8Array(4), SIDE)]).toEqual([0, 1, 0, 0]);
    expect([...hiddenByBody(splats, Uint8Array.of(1, 0, 0, 0), SIDE)]).toEqual([0, 0, 0, 0]);
  });
});

describe("nearest", () => {
  it("finds what asking everybody finds", () => {
    let seed = 1;
    const random = (): number => (seed = (seed * 16807) % 2147483647) / 2147483647;
    const points = Float32Array.from({ length: 3 * 400 }, (_, at) => random() * [0.5, 1.8, 0.02][at % 3]!);
    const found = nearest(points, 12);
    for (let i = 0; i < 400; i++) {
      const far = (j: number): number => [0, 1, 2].reduce((sum, axis) => sum + (points[3 * i + axis]! - points[3 * j + axis]!) ** 2, 0);
      const wanted = Array.from({ length: 400 }, (_, j) => j).sort((a, b) => far(a) - far(b)).slice(0, 12);
      expect([...found.slice(12 * i, 12 * i + 12)].map(far)).toEqual(wanted.map(far));
    }
  });
});

describe("cutOutPicture", () => {
  it("knows pixels all round which the matte is white", () => {
    const side = 6;
    const data = new Uint8ClampedArray(4 * side * side).fill(255);
    data.fill(24, 4 * (2 * side + 2), 4 * (2 * side + 2) + 3);
    const { rgb, known } = cutOutPicture(data, side);
    const rows = Array.from({ length: side }, (_, row) => [...known.slice(row * side, (row + 1) * side)].join(""));
    expect(rows).toEqual(["111111", "100011", "100011", "100011", "111111", "111111"]);
    expect(rgb[0]).toBe(1);
  });
});
