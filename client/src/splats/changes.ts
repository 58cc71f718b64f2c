/** Changes of splats' colours, as the shader takes them: three signed numbers of 10 bits in one. */

const BITS = 10;
/** A change by one in sRGB. */
const CHANGE_STEPS = (1 << (BITS - 1)) - 1;

/** sRGB below which a colour tells nothing about light, and by how much a room's light enlarges a change at most. */
const DARK = 0.02;
const MOST_GAIN = 2;

/**
 * GLSL: a splat's colour as drawn, with its change, which is as much brighter or darker as the light makes the splat
 * itself: `SplatRenderer._with_changes` of the server.
 */
export const CHANGE_SHADER = `
vec3 changed(vec3 colour, vec3 captured, uint change) {
  vec3 more = vec3((ivec3(int(change)) << ivec3(${[0, 1, 2].map((c) => 32 - BITS * (c + 1)).join()})) >> ${32 - BITS}) / ${CHANGE_STEPS}.0;
  float gain = dot(colour, vec3(1.0)) / max(dot(captured, vec3(1.0)), ${(3 * DARK).toFixed(3)});
  return clamp(colour + clamp(gain, 0.0, ${MOST_GAIN}.0) * more, 0.0, 1.0);
}
`;

/** Pack red, green and blue of each splat's change, -1 to 1. */
export function packChanges(changes: Float32Array): Uint32Array<ArrayBuffer> {
  const packed = new Uint32Array(changes.length / 3);
  const mask = (1 << BITS) - 1;
  for (let i = 0; i < packed.length; i++) {
    let all = 0;
    for (let c = 0; c < 3; c++) {
      const value = Math.max(-1, Math.min(changes[3 * i + c]!, 1));
      all |= (Math.round(CHANGE_STEPS * value) & mask) << (BITS * c);
    }
    packed[i] = all;
  }
  return packed;
}
