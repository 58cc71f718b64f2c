/**
 * A person's splats on the picture of a webcam: renderer/splats/rasteriser/projection_kernels.py, in a worker.
 *
 * The webcam is at the origin of the pose's world, which has y up, and looks along -z.
 */

import type { SplatFile } from "../splats/file";
import { allocateOffsets, moveSplats } from "../splats/moved";
import { CHEST } from "../splats/laid";
import { forwardKinematics, placeTakenToOrigin, TRANSFORM } from "../splats/skeleton";
import { NEAR_M } from "../splats/sort";
import type { PosePacket } from "../transport/packets";
import type { Vec3 } from "../viewpoint/geometry";
import { ClipLight } from "./clipLight";

/** Variance of a pixel's box filter, px^2. */
const PIXEL_FILTER_PX2 = 1 / 12;
const LEAST_AREA_PX4 = 1e-6;
/** Opacity below which a splat changes no 8-bit pixel. */
const MIN_OPACITY = 1 / 255;

/** fx, fy, cx, cy, px. */
export type Lens = readonly [number, number, number, number];

export class ProjectedSplats {
  /** Numbers a splat: x and y (px), inverse covariance (1/px^2), opacity, and how far (px) it reaches. */
  readonly x: Float32Array;
  readonly y: Float32Array;
  readonly conics: Float32Array;
  readonly opacity: Float32Array;
  readonly reach: Float32Array;
  /** m; nil: it is not drawn. */
  readonly depth: Float32Array;
  /** sRGB in the light of their clip, 0 to 1. */
  readonly colours: Float32Array;
  /** A transform a joint, and how far faces and hands move their splats, see `moveSplats`. */
  readonly transforms: Float32Array;
  readonly offsets: Float32Array;
  private readonly positions: Float32Array;
  private readonly light: ClipLight;
  private readonly blended = new Float32Array(TRANSFORM);

  constructor(private readonly person: SplatFile) {
    const { count } = person;
    this.x = new Float32Array(count);
    this.y = new Float32Array(count);
    this.conics = new Float32Array(3 * count);
    this.opacity = new Float32Array(count);
    this.reach = new Float32Array(2 * count);
    this.depth = new Float32Array(count);
    this.light = new ClipLight(person);
    this.colours = this.light.colours;
    this.transforms = new Float32Array(TRANSFORM * person.parents.length);
    this.offsets = allocateOffsets(person.moved.splats.length);
    this.positions = person.positions.slice();
  }

  /** Place every splat as it is in `pose`, in a picture of `side` px. */
  place(pose: PosePacket, lens: Lens, side: number): void {
    const { person, transforms, blended, depth } = this;
    forwardKinematics(person, pose.pelvis, pose.rotations, transforms);
    this.express(pose.expression);
    depth.fill(0);
    for (let i = 0; i < person.count; i++) {
      this.blend(i);
      this.light.shade(i, blended, this.positions);
      this.placeOne(i, lens, side);
    }
  }

  /** Where the webcam is as the chest sees it: at rest, m. */
  get webcam(): Vec3 {
    return placeTakenToOrigin(this.transforms, TRANSFORM * CHEST);
  }

  private express(expression: ArrayLike<number>): void {
    const { person, offsets, positions } = this;
    moveSplats(person.moved, expression, offsets);
    person.moved.splats.forEach((splat, row) => {
      for (let axis = 0; axis < 3; axis++) {
        positions[3 * splat + axis] = person.positions[3 * splat + axis]! + offsets[4 * row + axis]!;
      }
    });
  }

  private blend(i: number): void {
    const { blended, transforms } = this;
    const { joints, weights } = this.person;
    blended.fill(0);
    for (let k = 4 * i; k < 4 * i + 4; k++) {
      const weight = weights[k]! / 255;
      if (weight === 0) continue;
      const at = TRANSFORM * joints[k]!;
      for (let n = 0; n < TRANSFORM; n++) blended[n]! += weight * transforms[at + n]!;
    }
  }

  private placeOne(i: number, [fx, fy, cx, cy]: Lens, side: number): void {
    const { blended: m, positions } = this;
    const { covariances: v, opacities } = this.person;
    const px = positions[3 * i]!;
    const py = positions[3 * i + 1]!;
    const pz = positions[3 * i + 2]!;
    // y and z point the other way for a camera
    const x = m[0]! * px + m[1]! * py + m[2]! * pz + m[3]!;
    const y = -(m[4]! * px + m[5]! * py + m[6]! * pz + m[7]!);
    const z = -(m[8]! * px + m[9]! * py + m[10]! * pz + m[11]!);
    let opacity = opacities[i]! / 255;
    if (z <= NEAR_M || opacity <= MIN_OPACITY) return;
    // rows of the Jacobian times the rotation of the splat, and those times its covariance
    const sx = fx / z;
    const sy = fy / z;
    const tx = (-sx * x) / z;
    const ty = (-sy * y) / z;
    const ax = sx * m[0]! - tx * m[8]!;
    const ay = sx * m[1]! - tx * m[9]!;
    const az = sx * m[2]! - tx * m[10]!;
    const bx = -sy * m[4]! - ty * m[8]!;
    const by = -sy * m[5]! - ty * m[9]!;
    const bz = -sy * m[6]! - ty * m[10]!;
    const c = 6 * i;
    const ux = v[c]! * ax + v[c + 1]! * ay + v[c + 2]! * az;
    const uy = v[c + 1]! * ax + v[c + 3]! * ay + v[c + 4]! * az;
    const uz = v[c + 2]! * ax + v[c + 4]! * ay + v[c + 5]! * az;
    const wx = v[c]! * bx + v[c + 1]! * by + v[c + 2]! * bz;
    const wy = v[c + 1]! * bx + v[c + 3]! * by + v[c + 4]! * bz;
    const wz = v[c + 2]! * bx + v[c + 4]! * by + v[c + 5]! * bz;
    const xy = bx * ux + by * uy + bz * uz;
    const xx = ax * ux + ay * uy + az * uz + PIXEL_FILTER_PX2;
    const yy = bx * wx + by * wy + bz * wz + PIXEL_FILTER_PX2;
    const inverse = 1 / Math.max(xx * yy - xy * xy, 1e-12);
    const bare = (xx - PIXEL_FILTER_PX2) * (yy - PIXEL_FILTER_PX2) - xy * xy;
    opacity *= Math.sqrt(Math.max(bare, LEAST_AREA_PX4) * inverse);
    if (opacity <= MIN_OPACITY) return;
    const farthest = 2 * Math.log(opacity / MIN_OPACITY);
    const meanX = sx * x + cx;
    const meanY = sy * y + cy;
    const halfX = Math.sqrt(farthest * xx);
    const halfY = Math.sqrt(farthest * yy);
    if (meanX + halfX < 0 || meanY + halfY < 0 || meanX - halfX > side || meanY - halfY > side) return;
    this.x[i] = meanX;
    this.y[i] = meanY;
    this.conics[3 * i] = yy * inverse;
    this.conics[3 * i + 1] = -xy * inverse;
    this.conics[3 * i + 2] = xx * inverse;
    this.opacity[i] = opacity;
    this.reach[2 * i] = halfX;
    this.reach[2 * i + 1] = halfY;
    this.depth[i] = z;
  }
}
