/** A person's colours in the light of the clip they were filmed in: renderer/relighting/shading_kernels.py. */

import type { SplatFile } from "../splats/file";

/** sRGB by the root of linear light, which is nearly straight. */
const STEPS = 1024;
const ENCODED = Float32Array.from({ length: STEPS + 1 }, (_, step) => {
  const linear = (step / STEPS) ** 2;
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055;
});

export class ClipLight {
  /** sRGB of each splat, 0 to 1; of people whose light is not known always as filmed in the mean. */
  readonly colours: Float32Array;
  /** Linear. */
  private readonly albedo: Float32Array;

  constructor(private readonly person: SplatFile) {
    this.colours = Float32Array.from(person.colours, (value) => value / 255);
    this.albedo = Float32Array.from(person.albedos, (value) => linearOf(value / 255));
  }

  /** Shade a splat that lies at `positions` at rest and moves by `m`, seen from the origin. */
  shade(i: number, m: Float32Array, positions: Float32Array): void {
    const { albedo, colours, person } = this;
    const { light, normals } = person;
    if (!light) return;
    const turned = (r: number, of: ArrayLike<number>): number =>
      m[4 * r]! * of[3 * i]! + m[4 * r + 1]! * of[3 * i + 1]! + m[4 * r + 2]! * of[3 * i + 2]!;
    let [x, y, z] = [turned(0, normals), turned(1, normals), turned(2, normals)];
    const length = 1 / Math.sqrt(Math.max(x * x + y * y + z * z, 1e-12));
    [x, y, z] = [x * length, y * length, z * length];
    const [vx, vy, vz] = [-turned(0, positions) - m[3]!, -turned(1, positions) - m[7]!, -turned(2, positions) - m[11]!];
    const facing = x * vx + y * vy + z * vz;
    if (facing < 0) {
      // what shines through from the far side stands for what lies before it
      const twice = (2 * facing) / Math.max(vx * vx + vy * vy + vz * vz, 1e-12);
      [x, y, z] = [x - twice * vx, y - twice * vy, z - twice * vz];
    }
    for (let c = 0; c < 3; c++) {
      const irradiance =
        0.282095 * light[c]! +
        0.488603 * (y * light[3 + c]! + z * light[6 + c]! + x * light[9 + c]!) +
        1.092548 * (x * y * light[12 + c]! + y * z * light[15 + c]! + x * z * light[21 + c]!) +
        0.315392 * (3 * z * z - 1) * light[18 + c]! +
        0.546274 * (x * x - y * y) * light[24 + c]!;
      colours[3 * i + c] = srgbOf(albedo[3 * i + c]! * Math.max(irradiance, 0));
    }
  }
}

function linearOf(srgb: number): number {
  return srgb <= 0.04045 ? srgb / 12.92 : ((srgb + 0.055) / 1.055) ** 2.4;
}

function srgbOf(linear: number): number {
  const at = STEPS * Math.sqrt(Math.min(linear, 1));
  const step = Math.min(Math.floor(at), STEPS - 1);
  return ENCODED[step]! + (at - step) * (ENCODED[step + 1]! - ENCODED[step]!);
}
