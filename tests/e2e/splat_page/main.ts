/** The page's own splat pass, driven by a test: the very modules of the client, nothing of its own. */

import { decodePose } from "../../../client/src/packets";
import { castOf, shareWithin } from "../../../client/src/splats/cast";
import { readSplats } from "../../../client/src/splats/file";
import { passCamera, SplatPass, type PassFrame } from "../../../client/src/splats/pass";
import { contactShadows } from "../../../client/src/splats/room";
import { skin, TRANSFORM } from "../../../client/src/splats/skeleton";
import { depthOrder, depthRows, depths, emptyOrder } from "../../../client/src/splats/sort";
import type { Quaternion, Vec3 } from "../../../client/src/geometry";

interface Asked {
  /** Files and pose packets, one a person, base64. */
  files: string[];
  poses: string[];
  position: Vec3;
  wxyz: Quaternion;
  fovYRad: number;
  width: number;
  height: number;
  filmedOnly: boolean;
  most: number;
}

const bytes = (text: string): ArrayBuffer => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const canvas = document.querySelector("canvas") as HTMLCanvasElement;
const pass = new SplatPass(canvas);

function frameOf(asked: Asked): PassFrame {
  const files = asked.files.map(bytes);
  const whole = files.map((file) => readSplats(file));
  const share = shareWithin(whole.map(({ count }) => count), asked.most);
  const cast = castOf(share < 1 ? files.map((file) => readSplats(file, share)) : whole);
  pass.setCast(cast);
  const transforms = new Float32Array(TRANSFORM * cast.joints);
  const shadows = cast.people.flatMap((person, index) => {
    const pose = decodePose(bytes(asked.poses[index] ?? ""));
    if (!pose) throw new Error("a pose packet was expected");
    const at = index * TRANSFORM * person.parents.length;
    skin(person, pose.pelvis, pose.turns, transforms, at);
    return contactShadows(person, transforms, at);
  });
  const camera = passCamera(asked, asked.fovYRad, asked.width, asked.height);
  const depth = new Float32Array(cast.count);
  const order = emptyOrder(cast.count);
  depths(cast.bound, depthRows(transforms, camera.worldToCamera), depth);
  const count = depthOrder(depth, order);
  return { camera, transforms, order, count, shadows, filmedOnly: asked.filmedOnly };
}

Object.assign(window, {
  /** RGBA bytes, the top row first, base64. */
  picture(asked: Asked): string {
    pass.draw(frameOf(asked));
    return btoa(Array.from(pass.read(), (byte) => String.fromCharCode(byte)).join(""));
  },
});
