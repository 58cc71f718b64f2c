/**
 * What somebody's splats come to at their webcam's place, in all pixels of its picture: by the graphics card, which
 * takes a moment for what would take this worker longer than all else. Only where that draws people quickly.
 */

import { passCamera, type PassCamera } from "../splats/camera";
import type { SplatFile } from "../splats/file";
import { packSplats, type PackedSplats } from "../splats/packed";
import { NOBODY, SplatPass, type PassPeople } from "../splats/pass";
import type { Lens } from "./projected";

/** One person, with the changes of colours that they show. */
export interface Posed extends Pick<PassPeople, "transforms" | "offsets" | "order" | "count"> {
  person: SplatFile;
  changes: Uint32Array;
}

/** Draws somebody as their webcam sees them, in a picture of `side` px: premultiplied RGBA, the top row first. */
export interface DrawsPosed {
  draw(posed: Posed, lens: Lens, side: number): Uint8Array;
}

export class WebcamView implements DrawsPosed {
  private readonly pass: SplatPass;
  private readonly packed = new WeakMap<SplatFile, PackedSplats>();
  private person: SplatFile | null = null;

  /** Throws where a worker of this browser has no WebGL2. */
  constructor(canvas: HTMLCanvasElement | OffscreenCanvas) {
    this.pass = new SplatPass(canvas);
  }

  draw({ person, changes, ...posed }: Posed, lens: Lens, side: number): Uint8Array {
    this.show(person);
    this.pass.setChanges(changes);
    return this.pass.readPeople({ ...NOBODY, ...posed, growth: [1], yawsRad: [0] }, cameraOf(lens, side));
  }

  private show(person: SplatFile): void {
    if (person === this.person) return;
    this.person = person;
    const packed = this.packed.get(person) ?? packSplats([person]);
    this.packed.set(person, packed);
    this.pass.setSplats(packed);
  }
}

/** The webcam is at the origin of the pose's world, which has y up, and looks along -z. */
function cameraOf([fx, fy, cx, cy]: Lens, side: number): PassCamera {
  const looking = passCamera({ position: [0, 0, 0], wxyz: [0, 1, 0, 0] }, 1, side, side);
  return { ...looking, focalPx: [fx, fy], centrePx: [cx, cy] };
}
