/** Somebody made of a few splats, and poses of theirs. */

import type { SplatFile } from "../../src/splats/file";
import { NOTHING_MOVES } from "../../src/splats/moved";
import type { PosePacket } from "../../src/transport/packets";

/** Splats of one grey at these places (m), all on one joint at the origin, a centimetre wide. */
export function person(places: readonly (readonly [number, number, number])[], joint = 0): SplatFile {
  const count = places.length;
  const joints = joint + 1;
  return {
    count,
    levels: null,
    positions: Float32Array.from(places.flat()),
    covariances: Float32Array.from(places.flatMap(() => [1e-4, 0, 0, 1e-4, 0, 1e-4])),
    light: null,
    colours: new Uint8Array(3 * count).fill(102),
    albedos: new Uint8Array(3 * count).fill(102),
    normals: new Int8Array(3 * count).fill(0),
    opacities: new Uint8Array(count).fill(230),
    captureWeights: new Uint8Array(count).fill(255),
    joints: Uint8Array.from(places.flatMap(() => [joint, 0, 0, 0])),
    weights: Uint8Array.from(places.flatMap(() => [255, 0, 0, 0])),
    restJoints: new Float32Array(3 * joints),
    parents: Int16Array.from({ length: joints }, (_, i) => i - 1),
    moved: NOTHING_MOVES,
  };
}

/** Somebody `awayM` before their webcam, unturned. */
export function poseOf(awayM: number, captureTimeMs = 0, joints = 24): PosePacket {
  const rotations = Float32Array.from({ length: 4 * joints }, (_, i) => (i % 4 === 0 ? 1 : 0));
  const expression = new Float32Array(17);
  return { sequence: 1, captureTimeMs, index: 0, count: 1, check: 7, pelvis: [0, 0, -awayM], rotations, expression };
}

/** A wall of `side` x `side` splats, a centimetre apart. */
export function wall(side: number, z = 0): (readonly [number, number, number])[] {
  const at = (i: number): number => 0.01 * (i - (side - 1) / 2);
  return Array.from({ length: side * side }, (_, i) => [at(i % side), at(Math.floor(i / side)), z] as const);
}
