/** One person on a canvas of their own, in any pose, with the shadow under their feet. */

import type { Orbit } from "../viewpoint/viewpoint";
import { FOV_Y_RAD, orbitCamera } from "../viewpoint/viewpoint";
import type { Size } from "../viewpoint/framing";
import { passCamera } from "./camera";
import { readSplats } from "./file";
import { allocateOffsets, moveSplats } from "./moved";
import { packSplats, type PackedSplats } from "./packed";
import { SplatPass } from "./pass";
import { contactShadows } from "./room";
import { forwardKinematics, restRotations, TRANSFORM } from "./skeleton";
import { allocateOrder, depthOrder, depthRows, depths, displaced } from "./sort";

/** How somebody stands: pelvis (m) and rotations as of a pose packet. */
export interface PortraitPose {
  pelvis: ArrayLike<number>;
  rotations: ArrayLike<number>;
  /** Of face and hands; empty: at rest. */
  expression: ArrayLike<number>;
  yawRad: number;
}

export class Portrait {
  private readonly splats: PackedSplats;
  private readonly transforms: Float32Array;
  private readonly depth: Float32Array;

  /** Of the model in `bytes`, drawn by `pass`. Throws for a file that another release wrote. */
  constructor(
    private readonly pass: SplatPass,
    bytes: ArrayBuffer,
  ) {
    this.splats = packSplats([readSplats(bytes)]);
    this.transforms = new Float32Array(TRANSFORM * this.splats.joints);
    this.depth = new Float32Array(this.splats.count);
    pass.setSplats(this.splats);
  }

  /** At rest, where they stand in their own space. */
  get atRest(): PortraitPose {
    const [person] = this.splats.people;
    const rotations = restRotations(person?.parents.length ?? 0);
    return { pelvis: person?.restJoints.slice(0, 3) ?? [0, 0, 0], rotations, expression: [], yawRad: 0 };
  }

  draw({ pelvis, rotations, expression, yawRad }: PortraitPose, orbit: Orbit, { width, height }: Size): void {
    const { splats, transforms, depth } = this;
    const [person] = splats.people;
    if (!person) return;
    forwardKinematics(person, pelvis, rotations, transforms);
    const offsets = allocateOffsets(splats.moved);
    moveSplats(person.moved, expression, offsets, 0);
    const camera = passCamera(orbitCamera(orbit), FOV_Y_RAD, width, height);
    depths(displaced(splats.skinned, offsets), depthRows(transforms, camera.worldToCamera), depth);
    // a fresh one: the pass uploads an order that it does not know yet
    const order = allocateOrder(splats.count);
    const count = depthOrder(depth, order);
    const shadows = contactShadows(person, transforms, 0);
    this.pass.draw({ camera, transforms, offsets, shadows, order, count, growth: [1], yawsRad: [yawRad], hideUnseen: true });
  }
}
