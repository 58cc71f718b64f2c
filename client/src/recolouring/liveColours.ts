/**
 * A person's colours as their webcam sees them now: renderer/live_look/live_look.py, in a worker of the page. A test
 * holds both to the same changes of the same pictures.
 */

import { PICTURE_PX } from "../look/cutOut";
import { packChanges } from "../splats/changes";
import type { SplatFile } from "../splats/file";
import { packDetail, packPlaces, type LaidPicture } from "../splats/laid";
import { allocateOrder, depthOrder } from "../splats/sort";
import type { PosePacket } from "../transport/packets";
import { Coring, exposureBeside } from "./coring";
import { Detail, type FinePicture } from "./detail";
import { finestLevel, ofAllLevels, placesOfAllLevels } from "./finestLevel";
import { Footprints } from "./footprints";
import { hiddenByBody, hiddenByLimbs, limbSplats } from "./hidden";
import { nearest } from "./neighbours";
import type { CutOutPicture } from "./pictureReader";
import { ProjectedSplats, type Lens } from "./projected";
import type { DrawsPosed } from "./webcamView";

/** Steps of colours a picture; what is left is made up for in the next ones. */
const STEPS = 2;
const OVERSTEP = 1.7;
/** Share of the last picture's change with which the next one begins. */
const KEPT = 0.8;
/** Added to the weight of a splat's pixels: who is hardly shown hardly changes. */
const LEAST_PX = 0.05;
/** Difference, in sRGB, as which a larger one counts. */
const MOST = 0.5;
/** Share of an open splat's pixels from which one takes all of its live colour; and below which it is hidden. */
const SEEN = 0.2;
const HARDLY = 0.1;
/** Of the pixels shown of splats, that which is an open one's. */
const OPEN_SHARE = 0.95;
const NEIGHBOURS = 12;
/** Weight of no change beside the neighbours' shares. */
const LITTLE = 0.5;
const HELD_S = 1.5;
const GONE_S = 1;
const COMES_S = 0.1;
const EXPOSURE_S = 1;
const UNCHANGED = [1, 1, 1] as const;

export class LiveColours {
  private readonly splats: ProjectedSplats;
  private readonly footprints: Footprints;
  private readonly limbs: Uint8Array;
  private readonly near: Uint32Array;
  private readonly change: Float32Array;
  /** How much of its live colour each splat shows. */
  private readonly share: Float32Array;
  /** How well each splat is seen in the newest picture. */
  private readonly laidShare: Float32Array;
  private readonly seenS: Float64Array;
  private exposure: number[] | null = null;
  /** What each splat lacks in its pixels, summed, and the weight of those that are known and of all. */
  private readonly lacking: Float32Array;
  private readonly knownPx: Float32Array;
  private readonly shownPx: Float32Array;
  private readonly colours: Float32Array;
  private readonly pixels: Float32Array;
  /** What was added to the colours last. */
  private readonly shown: Float32Array;
  private readonly coring: Coring;
  private readonly detail: Detail;
  private lens: Lens = [1, 1, 0, 0];
  private readonly order: Uint32Array;
  private timeS: number | null = null;

  /** The finest level of the file, and where in it each splat is. */
  private readonly person: SplatFile;
  private readonly places: Uint32Array;

  /** Of the person in `file`, from pictures of `side` px. */
  constructor(
    private readonly file: SplatFile,
    private readonly side: number,
  ) {
    const { splats: person, places } = finestLevel(file);
    const { count } = person;
    [this.person, this.places] = [person, places];
    this.splats = new ProjectedSplats(person);
    this.footprints = new Footprints(count, side);
    this.limbs = limbSplats(person);
    this.near = nearest(person.positions, Math.min(NEIGHBOURS, count));
    this.change = new Float32Array(3 * count);
    this.share = new Float32Array(count);
    this.laidShare = new Float32Array(count);
    this.seenS = new Float64Array(count).fill(-Infinity);
    this.lacking = new Float32Array(3 * count);
    this.knownPx = new Float32Array(count);
    this.shownPx = new Float32Array(count);
    this.colours = new Float32Array(3 * count);
    this.pixels = new Float32Array(4 * side * side);
    this.shown = new Float32Array(3 * count);
    this.coring = new Coring(side);
    this.detail = new Detail(PICTURE_PX);
    this.order = new Uint32Array(count);
  }

  /** Take the colours of a picture, which shows them in `pose`; its capture time is the picture's moment. */
  see(picture: CutOutPicture, pose: PosePacket, lens: Lens): void {
    const { splats, footprints, change, side } = this;
    const timeS = pose.captureTimeMs / 1000;
    const passedS = this.timeS === null ? COMES_S : Math.max(timeS - this.timeS, 0);
    this.timeS = timeS;
    this.lens = lens;
    splats.place(pose, lens, side);
    footprints.fill(splats, this.order, depthOrder(splats.depth, this.order));
    const through = hiddenByBody(splats, this.limbs, side);
    const behind = hiddenByLimbs(splats, this.limbs, side, lens[0]).map((hidden, i) => hidden | through[i]!);
    footprints.draw(splats.colours, this.pixels);
    this.followExposure(exposureBeside(picture, this.pixels), passedS);
    const wanted = this.coring.of(picture, this.pixels, this.exposure ?? UNCHANGED);
    for (let at = 0; at < change.length; at++) change[at]! *= KEPT;
    for (let step = 0; step < STEPS; step++) {
      this.findLacking(wanted);
      this.gather();
      this.step(behind);
    }
    const base = splats.colours;
    for (let at = 0; at < change.length; at++) change[at] = Math.max(-base[at]!, Math.min(change[at]!, 1 - base[at]!));
    behind.forEach((hidden, i) => {
      if (hidden) this.knownPx[i] = 0;
    });
    this.follow(timeS, passedS);
  }

  /** What is added to the captured colour of each splat of the file at `timeS`, as the card takes it. */
  changesAt(timeS: number): Uint32Array<ArrayBuffer> {
    const { change, near, person, seenS, shown } = this;
    const many = near.length / Math.max(1, person.count);
    const share = this.share.map((one, i) => one * held(timeS - seenS[i]!));
    const otherwise = (this.exposure ?? UNCHANGED).map((one) => (LITTLE * (one - 1)) / 255);
    for (let i = 0; i < person.count; i++) {
      const own = share[i]!;
      let red = 0;
      let green = 0;
      let blue = 0;
      let known = 0;
      for (let m = many * i; own < 1 && m < many * (i + 1); m++) {
        const j = near[m]!;
        const weight = share[j]!;
        known += weight;
        red += weight * change[3 * j]!;
        green += weight * change[3 * j + 1]!;
        blue += weight * change[3 * j + 2]!;
      }
      const scale = (1 - own) / (known + LITTLE);
      shown[3 * i] = own * change[3 * i]! + scale * (red + otherwise[0]! * person.colours[3 * i]!);
      shown[3 * i + 1] = own * change[3 * i + 1]! + scale * (green + otherwise[1]! * person.colours[3 * i + 1]!);
      shown[3 * i + 2] = own * change[3 * i + 2]! + scale * (blue + otherwise[2]! * person.colours[3 * i + 2]!);
    }
    return packChanges(ofAllLevels(this.file, this.places, shown));
  }

  /**
   * What the picture that was seen last shows, in all its pixels, beyond the colours that `changesAt` told last; `view`
   * draws what they come to.
   */
  laidPicture(picture: FinePicture, view: DrawsPosed): LaidPicture {
    const { footprints, laidShare, person, share, shown, splats } = this;
    const [fx, fy, cx, cy] = this.lens;
    const finer = picture.side / this.side;
    const lens = [finer * fx, finer * fy, finer * cx, finer * cy] as const;
    const { count, order: sorted } = footprints;
    const order = allocateOrder(person.count);
    order.set(sorted.subarray(0, count));
    const { transforms } = splats;
    const posed = { person, transforms, offsets: splats.offsets.slice(), order, count, changes: packChanges(shown) };
    const detail = packDetail(this.detail.of(picture, view.draw(posed, lens, picture.side)));
    const places = new Float32Array(3 * person.count);
    for (let i = 0; i < person.count; i++) {
      places[3 * i] = finer * splats.x[i]!;
      places[3 * i + 1] = finer * splats.y[i]!;
      places[3 * i + 2] = Math.min(laidShare[i]!, share[i]!);
    }
    const all = placesOfAllLevels(this.file, this.places, places);
    return { detail, places: packPlaces(all), webcam: splats.webcam, focalPx: lens[0] };
  }

  /** What each pixel lacks beside what the splats, in their present colours, come to. */
  private findLacking({ rgb, known }: CutOutPicture): void {
    const { change, colours, footprints, pixels, splats } = this;
    for (let at = 0; at < change.length; at++) colours[at] = splats.colours[at]! + change[at]!;
    footprints.draw(colours, pixels);
    for (let pixel = 0; pixel < known.length; pixel++) {
      const covered = pixels[4 * pixel + 3]!;
      const sure = known[pixel]! * covered;
      for (let c = 0; c < 3; c++) {
        const at = 4 * pixel + c;
        const lacks = sure > 0 ? rgb[3 * pixel + c]! - pixels[at]! / covered : 0;
        pixels[at] = sure * Math.max(-MOST, Math.min(lacks, MOST));
      }
      pixels[4 * pixel + 3] = sure;
    }
  }

  private gather(): void {
    const { footprints, knownPx, lacking, pixels, shownPx } = this;
    const { starts, order, pixels: where, weights } = footprints;
    lacking.fill(0);
    knownPx.fill(0);
    shownPx.fill(0);
    for (let n = 0; n < footprints.count; n++) {
      let red = 0;
      let green = 0;
      let blue = 0;
      let known = 0;
      let shown = 0;
      const end = starts[n + 1]!;
      for (let at = starts[n]!; at < end; at++) {
        const pixel = 4 * where[at]!;
        const weight = weights[at]!;
        red += weight * pixels[pixel]!;
        green += weight * pixels[pixel + 1]!;
        blue += weight * pixels[pixel + 2]!;
        known += weight * pixels[pixel + 3]!;
        shown += weight;
      }
      const i = order[n]!;
      lacking[3 * i] = red;
      lacking[3 * i + 1] = green;
      lacking[3 * i + 2] = blue;
      knownPx[i] = known;
      shownPx[i] = shown;
    }
  }

  private step(behind: Uint8Array): void {
    const { change, knownPx, lacking } = this;
    for (let i = 0; i < behind.length; i++) {
      if (behind[i]) continue;
      const scale = OVERSTEP / (knownPx[i]! + LEAST_PX);
      for (let at = 3 * i; at < 3 * i + 3; at++) change[at]! += scale * lacking[at]!;
    }
  }

  /** Bring the exposure nearer to the newest picture's; the first is taken as it is. */
  private followExposure(found: readonly number[] | null, passedS: number): void {
    if (!found) return;
    const before = this.exposure ?? found;
    this.exposure = found.map((one, c) => before[c]! + Math.min(1, passedS / EXPOSURE_S) * (one - before[c]!));
  }

  /** Note what was seen at `timeS`. */
  private follow(timeS: number, passedS: number): void {
    const { laidShare, share, seenS } = this;
    const most = passedS / COMES_S;
    const shown = this.shownOf();
    const some = shown.filter((one) => one > 0).sort();
    const openPx = some.length > 0 ? percentile(some, OPEN_SHARE) : 1;
    shown.forEach((one, i) => {
      const wanted = Math.min(one / (SEEN * openPx), 1);
      laidShare[i]! += Math.max(-most, Math.min(wanted - laidShare[i]!, most));
      if (one === 0) laidShare[i] = 0;
      const seen = wanted > HARDLY;
      if (!seen && held(timeS - seenS[i]!) <= 0) share[i] = 0;
      share[i]! += Math.min(Math.max(wanted - share[i]!, 0), most);
      if (seen) seenS[i] = timeS;
    });
  }

  /** Pixels that show each splat, at most one, times the share of its own light that reaches them. */
  private shownOf(): Float32Array {
    const { depth, conics, opacity } = this.splats;
    return this.shownPx.map((px, i) => {
      if (depth[i] === 0) return 0;
      const density = Math.max(conics[3 * i]! * conics[3 * i + 2]! - conics[3 * i + 1]! ** 2, 1e-12);
      const alone = (2 * Math.PI * opacity[i]!) / Math.sqrt(density);
      const reaches = Math.min(px / Math.max(alone, 1e-6), 1);
      return (Math.min(px, 1) * reaches * this.knownPx[i]!) / Math.max(px, 1e-6);
    });
  }
}

/** Share of a live colour that is left so long after it was seen. */
function held(ageS: number): number {
  const gone = Math.max(0, Math.min((ageS - HELD_S) / GONE_S, 1));
  return 1 - gone * gone * (3 - 2 * gone);
}

function percentile(sorted: Float32Array, share: number): number {
  const place = (sorted.length - 1) * share;
  const below = sorted[Math.floor(place)]!;
  return below + (place - Math.floor(place)) * (sorted[Math.ceil(place)]! - below);
}
