/** The page's own splat pass, driven by a test: the client's own modules. */

import { decodePose } from "../../../client/src/transport/packets";
import { packSplats, shareWithin } from "../../../client/src/splats/packed";
import { growths, readSplats } from "../../../client/src/splats/file";
import { finest } from "../../../client/src/splats/levels";
import { allocateOffsets, moveSplats } from "../../../client/src/splats/moved";
import { packDetail, packPlaces, type LaidPicture } from "../../../client/src/splats/laid";
import { passCamera } from "../../../client/src/splats/camera";
import { SplatPass, type PassFrame } from "../../../client/src/splats/pass";
import { contactShadows, decodePanorama } from "../../../client/src/splats/room";
import { forwardKinematics, TRANSFORM } from "../../../client/src/splats/skeleton";
import { depthOrder, depthRows, depths, allocateOrder, displaced } from "../../../client/src/splats/sort";
import { decodeLook } from "../../../client/src/recolouring/packets";
import { LiveColours } from "../../../client/src/recolouring/liveColours";
import { WebcamView } from "../../../client/src/recolouring/webcamView";
import { PICTURE_PX } from "../../../client/src/look/cutOut";
import { cutOutPicture, finePicture } from "../../../client/src/recolouring/pictureReader";
import type { Quaternion, Vec3 } from "../../../client/src/viewpoint/geometry";
import type { Light } from "../../../client/src/api/types";

interface Asked {
  /** Files and pose packets, one a person, base64. */
  files: string[];
  poses: string[];
  position: Vec3;
  wxyz: Quaternion;
  fovYRad: number;
  width: number;
  height: number;
  hideUnseen: boolean;
  most: number;
  /** The panorama's file, base64, and its light; the studio, where nothing is said. */
  place?: { picture: string; light: Light };
  /** Whether a screen is shared: its left half red, its right half blue, below a white line. */
  screen?: boolean;
  /** Splats of the level at which each person is drawn; the finest, where nothing is said. */
  kept?: number[];
  /** About +y, by which each person was turned. */
  yawsRad: number[];
  /** What live look changes, a packed number a splat, base64; nothing, where nothing is said. */
  changes?: string;
  laid?: Laid[];
}

/**
 * A picture that is laid on the person at this place of the cast: floats, base64. Of each splat, in the file's order,
 * x and y (px of the picture) and share; red, green and blue of each pixel's factor.
 */
interface Laid {
  index: number;
  places: string;
  detail: string;
  webcam: Vec3;
  focalPx: number;
}

/**
 * A person's file and pictures of them as they are sent, RGBA of `side` px, with the packets of their poses; base64.
 * `fine`: the same picture, `PICTURE_PX` large.
 */
interface Seen {
  file: string;
  side: number;
  seen: { picture: string; fine?: string; packet: string }[];
}

const bytes = (text: string): ArrayBuffer => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const base64 = (data: Uint8Array): string => btoa(Array.from(data, (byte) => String.fromCharCode(byte)).join(""));
const canvas = document.querySelector("canvas") as HTMLCanvasElement;
const pass = new SplatPass(canvas);
const webcamView = new WebcamView(new OffscreenCanvas(1, 1));

function frameOf(asked: Asked): PassFrame {
  const files = asked.files.map(bytes);
  const whole = files.map((file) => readSplats(file));
  const share = shareWithin(whole.map(finest), asked.most);
  const splats = packSplats(share < 1 ? files.map((file) => readSplats(file, share)) : whole);
  pass.setSplats(splats);
  const changes = asked.changes === undefined ? new Uint32Array(splats.count) : new Uint32Array(bytes(asked.changes));
  pass.setChanges(changes, laidOn(splats.people.length, asked.laid ?? []));
  const transforms = new Float32Array(TRANSFORM * splats.joints);
  const offsets = allocateOffsets(splats.moved);
  let moved = 0;
  const shadows = splats.people.flatMap((person, index) => {
    const pose = decodePose(bytes(asked.poses[index] ?? ""));
    if (!pose) throw new Error("a pose packet was expected");
    const at = index * TRANSFORM * person.parents.length;
    moveSplats(person.moved, pose.expression, offsets, moved);
    moved += person.moved.splats.length;
    forwardKinematics(person, pose.pelvis, pose.rotations, transforms, at);
    return contactShadows(person, transforms, at);
  });
  const camera = passCamera(asked, asked.fovYRad, asked.width, asked.height);
  const depth = new Float32Array(splats.count);
  const order = allocateOrder(splats.count);
  const kept = asked.kept ?? splats.people.map(finest);
  depths(displaced(splats.skinned, offsets), depthRows(transforms, camera.worldToCamera), depth, kept);
  const count = depthOrder(depth, order);
  const growth = growths(splats.people, kept);
  return { camera, transforms, offsets, order, count, growth, yawsRad: asked.yawsRad, shadows, hideUnseen: asked.hideUnseen };
}

function laidOn(people: number, laid: readonly Laid[]): (LaidPicture | null)[] {
  const on = Array.from({ length: people }, (): LaidPicture | null => null);
  for (const { index, places, detail, webcam, focalPx } of laid) {
    const floats = (text: string): Float32Array => new Float32Array(bytes(text));
    on[index] = { places: packPlaces(floats(places)), detail: packDetail(floats(detail)), webcam, focalPx };
  }
  return on;
}

function testScreen(): HTMLCanvasElement {
  const made = document.createElement("canvas");
  const context = made.getContext("2d") as CanvasRenderingContext2D;
  [made.width, made.height] = [320, 180];
  for (const [colour, x, y, width, height] of [["red", 0, 0, 160, 180], ["blue", 160, 0, 160, 180], ["white", 0, 0, 320, 40]] as const) {
    context.fillStyle = colour;
    context.fillRect(x, y, width, height);
  }
  return made;
}

Object.assign(window, {
  /** RGBA bytes, the top row first, base64. */
  async picture(asked: Asked): Promise<string> {
    const { place } = asked;
    const panorama = place ? await decodePanorama(new Blob([bytes(place.picture)])) : null;
    pass.setEnvironment({ panorama, light: place?.light ?? null });
    const screen = asked.screen ? testScreen() : null;
    pass.placeScreen({ centre: [0, 1.72, -1.9], azimuthRad: 0 });
    pass.setScreen(screen, screen?.width, screen?.height);
    pass.draw(frameOf(asked));
    return base64(pass.read());
  },
  /** What each picture in turn comes to, a packed number a splat, base64. */
  recoloured({ file, side, seen }: Seen): string[] {
    const colours = new LiveColours(readSplats(bytes(file)), side);
    return seen.map(({ picture, packet }) => {
      const told = decodeLook(bytes(packet));
      if (told?.kind !== "pose") throw new Error("a pose was expected");
      colours.see(cutOutPicture(new Uint8ClampedArray(bytes(picture)), side), told.pose, told.lens);
      return base64(new Uint8Array(colours.changesAt(told.pose.captureTimeMs / 1000).buffer));
    });
  },
  /** What comes to be laid on the person: packed numbers of splats and pixels, base64, and where the webcam is. */
  laidOf({ file, side, seen }: Seen) {
    const colours = new LiveColours(readSplats(bytes(file)), side);
    return seen.map(({ picture, fine, packet }) => {
      const told = decodeLook(bytes(packet));
      if (told?.kind !== "pose" || fine === undefined) throw new Error("a pose and a fine picture were expected");
      colours.see(cutOutPicture(new Uint8ClampedArray(bytes(picture)), side), told.pose, told.lens);
      const changes = colours.changesAt(told.pose.captureTimeMs / 1000);
      const laid = colours.laidPicture(finePicture(new Uint8ClampedArray(bytes(fine)), PICTURE_PX), webcamView);
      const packed = (numbers: Uint32Array): string => base64(new Uint8Array(numbers.buffer));
      const { webcam, focalPx } = laid;
      return { changes: packed(changes), detail: packed(laid.detail), places: packed(laid.places), webcam, focalPx };
    });
  },
});
