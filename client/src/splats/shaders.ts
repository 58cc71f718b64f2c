/**
 * GLSL of the splat pass. It follows the server's rasteriser (renderer/splats/rasteriser/projection_kernels.py and
 * tile_kernels.py) and light (renderer/relighting/shading_kernels.py) formula by formula; a test compares their pictures.
 *
 * Letters: M = sum_k w_k T_k the blended transform, p = R M x + t the camera point, J the perspective's
 * Jacobian; the covariance on the picture is J R A V A^T R^T J^T + pixel filter (EWA splatting,
 * Zwicker et al. 2001). Each splat is placed in the picture once, into a texture in the order of
 * drawing; the corners of its triangle only read that. On a phone's card, which runs vertices twice,
 * and on a processor, where they are dear, that is most of what splats cost.
 */

import { OWNER_BITS } from "./packed";
import { CHANGE_SHADER } from "./changes";
import { LARGEST_DETAIL, PLACE_BITS, PLACE_STEPS, SHARE_STEPS } from "./laid";
import { MOVED_COLUMNS } from "./moved";
import { PICTURE_PX } from "../look/cutOut";
import { NEAR_M, ORDER_COLUMNS } from "./sort";

/** Variance of a pixel's box filter, px^2: BOX_FILTER_PX2 of the server. */
const PIXEL_FILTER_PX2 = 1 / 12;
/** Determinant of a covariance from which a splat counts as no smaller, px^4: LEAST_AREA_PX4. */
const LEAST_AREA_PX4 = 1e-6;
/** Opacity below which a splat changes no 8-bit pixel. */
const MIN_OPACITY = 1 / 255;
const MAX_OPACITY = 0.99;
/** Alpha up to which a splat shows too little of a picture laid on it to be worth a look into that. */
const LEAST_LAID = 1 / 64;
/** Splats a row of the table; four texels each. */
export const TABLE_COLUMNS = 256;
/** People of a meeting. */
export const MAX_PEOPLE = 12;

const float = (value: number): string => value.toFixed(9);

/** `source` for views in which somebody's picture is laid on them (`LaidPicture`). */
export function laying(source: string): string {
  return source.replace("\n", "\n#define LAID\n");
}

/** A fragment a splat: where it is drawn, and its colour. */
export const PROJECT_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;

uniform usampler2D table;
uniform usampler2D order;
uniform sampler2D transforms;
uniform sampler2D offsets; // m, at rest, of the splats that faces and hands move
uniform usampler2D changes; // of colours, by live look
uniform mat3 rotation; // world -> camera
uniform vec3 translation;
uniform vec2 focal; // px
uniform vec2 centre;
uniform vec2 size;
uniform bool hideUnseen;
uniform vec3 eye; // m
uniform bool lit[${MAX_PEOPLE}]; // by the room or as in their clip; else in the mean colours of that
uniform vec3 harmonics[9 * ${MAX_PEOPLE}];
uniform vec2 clipYaw[${MAX_PEOPLE}]; // cosine and sine of the yaw by which that light was turned
uniform vec3 keyDirection;
uniform vec3 keyColour;
uniform float growth[${MAX_PEOPLE}]; // of variances, a person
#ifdef LAID
uniform usampler2D places; // in the pictures that are laid on people
uniform vec3 laid[${MAX_PEOPLE}]; // a person: strength, px of the picture for one of the view, layer
#endif
// without LAID: mean, px, and the major half axis at one standard deviation
// with it: mean; axis; minor over major axis, cutoff
layout(location = 0) out uvec4 ellipse;
// without LAID: minor over major axis, cutoff in standard deviations (0: culled), colour
// with it: place and layer; strength, px of the picture for one of the view; colour
layout(location = 1) out uvec4 appearance;

vec4 transformRow(uint joint, int r) {
  return texelFetch(transforms, ivec2(r, int(joint)), 0);
}

vec3 unpackRgb(uint packed) {
  return vec3((uvec3(packed) >> uvec3(0u, 8u, 16u)) & 0xffu) / 255.0;
}

vec3 unpackNormal(uint packed) {
  return vec3((ivec3(int(packed)) << ivec3(24, 16, 8)) >> 24);
}

vec3 toLinear(vec3 srgb) {
  return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), step(0.04045, srgb));
}

vec3 toSrgb(vec3 linear) {
  vec3 c = clamp(linear, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

${CHANGE_SHADER}
/** sRGB of an albedo (sRGB) on somebody's surface that faces n, seen from v further on. */
vec3 shade(uint owner, vec3 albedo, vec3 n, vec3 v) {
  n *= inversesqrt(max(dot(n, n), 1e-12));
  // what shines through from the far side stands for what lies before it
  float facing = dot(n, v);
  if (facing < 0.0) n -= 2.0 * facing / max(dot(v, v), 1e-12) * v;
  vec3 keyLight = max(dot(n, keyDirection), 0.0) * keyColour;
  vec2 yaw = clipYaw[owner];
  n.xz = vec2(yaw.x * n.x - yaw.y * n.z, yaw.y * n.x + yaw.x * n.z);
  uint first = 9u * owner;
  vec3 irradiance = 0.282095 * harmonics[first]
    + 0.488603 * (n.y * harmonics[first + 1u] + n.z * harmonics[first + 2u] + n.x * harmonics[first + 3u])
    + 1.092548 * (n.x * n.y * harmonics[first + 4u] + n.y * n.z * harmonics[first + 5u] + n.x * n.z * harmonics[first + 7u])
    + 0.315392 * (3.0 * n.z * n.z - 1.0) * harmonics[first + 6u]
    + 0.546274 * (n.x * n.x - n.y * n.y) * harmonics[first + 8u];
  irradiance = max(irradiance, 0.0) + keyLight;
  return toSrgb(toLinear(albedo) * irradiance);
}

void main() {
  ellipse = appearance = uvec4(0u);
  uint splat = texelFetch(order, ivec2(gl_FragCoord.xy), 0).x;
  ivec2 texel = ivec2(4 * int(splat % ${TABLE_COLUMNS}u), int(splat / ${TABLE_COLUMNS}u));
  uvec4 t0 = texelFetch(table, texel, 0);
  uvec4 t1 = texelFetch(table, texel + ivec2(1, 0), 0);
  uvec4 t2 = texelFetch(table, texel + ivec2(2, 0), 0);
  uvec4 t3 = texelFetch(table, texel + ivec2(3, 0), 0);
  vec4 x = vec4(uintBitsToFloat(t0.xyz), 1.0);
  uint owner = t3.w & ${(1 << OWNER_BITS) - 1}u;
  int moved = int(t3.w >> ${OWNER_BITS}u) - 1;
  if (moved >= 0) x.xyz += texelFetch(offsets, ivec2(moved % ${MOVED_COLUMNS}, moved / ${MOVED_COLUMNS}), 0).xyz;
  vec4 v = uintBitsToFloat(t1);
  vec2 w = uintBitsToFloat(t2.xy);
  uvec4 joints = uvec4(t0.w & 0xffffu, t0.w >> 16u, t2.z & 0xffffu, t2.z >> 16u);
  uvec4 weights = (uvec4(t2.w) >> uvec4(0u, 8u, 16u, 24u)) & 0xffu;
  float opacity = float(t3.y >> 24u) / 255.0;
  mat3 covariance = mat3(v.x, v.y, v.z, v.y, v.w, w.x, v.z, w.x, w.y) * growth[owner];
  if (hideUnseen) opacity *= float(t3.x >> 24u) / 255.0;

  vec4 m0 = vec4(0.0), m1 = vec4(0.0), m2 = vec4(0.0);
  for (int k = 0; k < 4; k++) {
    if (weights[k] == 0u) continue;
    float weight = float(weights[k]) / 255.0;
    m0 += weight * transformRow(joints[k], 0);
    m1 += weight * transformRow(joints[k], 1);
    m2 += weight * transformRow(joints[k], 2);
  }
  vec3 world = vec3(dot(m0, x), dot(m1, x), dot(m2, x));
  vec3 p = rotation * world + translation;
  mat3 modelView = rotation * transpose(mat3(m0.xyz, m1.xyz, m2.xyz));
  if (p.z <= ${float(NEAR_M)} || opacity <= ${float(MIN_OPACITY)}) return;

  vec2 scale = focal / p.z;
  vec3 jacobianX = vec3(scale.x, 0.0, -scale.x * p.x / p.z) * modelView;
  vec3 jacobianY = vec3(0.0, scale.y, -scale.y * p.y / p.z) * modelView;
  float xx = dot(jacobianX, covariance * jacobianX) + ${float(PIXEL_FILTER_PX2)};
  float xy = dot(jacobianX, covariance * jacobianY);
  float yy = dot(jacobianY, covariance * jacobianY) + ${float(PIXEL_FILTER_PX2)};
  float unfiltered = (xx - ${float(PIXEL_FILTER_PX2)}) * (yy - ${float(PIXEL_FILTER_PX2)}) - xy * xy;
  opacity *= sqrt(max(unfiltered, ${float(LEAST_AREA_PX4)}) / (xx * yy - xy * xy));
  if (opacity <= ${float(MIN_OPACITY)}) return;
  float halfTrace = 0.5 * (xx + yy);
  float radius = length(vec2(0.5 * (xx - yy), xy));
  float majorVariance = halfTrace + radius;
  float minorVariance = max(halfTrace - radius, ${float(PIXEL_FILTER_PX2)});
  vec2 majorAxis = abs(xy) > 1e-6 ? normalize(vec2(majorVariance - yy, xy)) : (xx >= yy ? vec2(1.0, 0.0) : vec2(0.0, 1.0));
  float cutoff = sqrt(2.0 * log(opacity / ${float(MIN_OPACITY)}));
  vec2 meanPx = scale * p.xy + centre;
  float radiusPx = cutoff * sqrt(majorVariance);
  // what lies wholly beside the picture costs no quad
  if (any(lessThan(meanPx, vec2(-radiusPx))) || any(greaterThan(meanPx, size + radiusPx))) return;
  vec3 colour = unpackRgb(t3.x);
  if (lit[owner]) {
    vec3 normal = unpackNormal(t3.z) * mat3(m0.xyz, m1.xyz, m2.xyz);
    colour = shade(owner, unpackRgb(t3.y), normal, eye - world);
  }
  uint change = texelFetch(changes, ivec2(splat % ${TABLE_COLUMNS}u, splat / ${TABLE_COLUMNS}u), 0).x;
  if (change != 0u) colour = changed(colour, unpackRgb(t3.x), change);
  majorAxis *= sqrt(majorVariance);
  float ratio = sqrt(minorVariance / majorVariance);
  uvec2 packedColour = uvec2(packHalf2x16(colour.rg), packHalf2x16(vec2(colour.b, opacity)));
#ifdef LAID
  uint place = texelFetch(places, ivec2(splat % ${TABLE_COLUMNS}u, splat / ${TABLE_COLUMNS}u), 0).x;
  vec3 on = laid[owner];
  float strength = on.x * float(place >> ${2 * PLACE_BITS}u) / ${SHARE_STEPS}.0;
  ellipse = uvec4(floatBitsToUint(meanPx), packHalf2x16(majorAxis), packHalf2x16(vec2(ratio, cutoff)));
  place = (place & ${2 ** (2 * PLACE_BITS) - 1}u) | uint(on.z) << ${2 * PLACE_BITS}u;
  appearance = uvec4(place, packHalf2x16(vec2(strength, on.y)), packedColour);
#else
  ellipse = floatBitsToUint(vec4(meanPx, majorAxis));
  appearance = uvec4(floatBitsToUint(ratio), floatBitsToUint(cutoff), packedColour);
#endif
}
`;

export const SPLAT_VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;

uniform usampler2D ellipses;
uniform usampler2D appearances;
uniform vec2 size;
out vec2 offset; // from the mean, in standard deviations
flat out vec4 colour;
#ifdef LAID
out vec2 place; // in the picture that is laid on, of its width
flat out vec2 laid; // strength and layer
#endif

void main() {
  // three corners a splat: instances are drawn one by one where a processor stands in for the card,
  // which also takes longer to begin a triangle than to fill the more that one has than two
  int instance = gl_VertexID / 3;
  int corner = gl_VertexID - 3 * instance;
  ivec2 texel = ivec2(instance % ${ORDER_COLUMNS}, instance / ${ORDER_COLUMNS});
  uvec4 ellipse = texelFetch(ellipses, texel, 0);
  uvec4 appearance = texelFetch(appearances, texel, 0);
  vec2 mean = uintBitsToFloat(ellipse.xy);
#ifdef LAID
  vec2 majorAxis = unpackHalf2x16(ellipse.z);
  vec2 shape = unpackHalf2x16(ellipse.w);
#else
  vec2 majorAxis = uintBitsToFloat(ellipse.zw);
  vec2 shape = uintBitsToFloat(appearance.xy);
#endif
  float ratio = shape.x;
  float cutoff = shape.y;
  offset = cutoff * (corner == 0 ? vec2(0.0, 2.0) : vec2(corner == 1 ? ${float(Math.sqrt(3))} : ${float(-Math.sqrt(3))}, -1.0));
  colour = vec4(unpackHalf2x16(appearance.z), unpackHalf2x16(appearance.w));
  vec2 beside = offset.x * majorAxis + offset.y * ratio * vec2(-majorAxis.y, majorAxis.x);
  vec2 position = mean + beside;
#ifdef LAID
  vec2 centre = vec2((uvec2(appearance.x) >> uvec2(0u, ${PLACE_BITS}u)) & ${PLACE_STEPS}u) / ${PLACE_STEPS}.0;
  vec2 on = unpackHalf2x16(appearance.y);
  place = centre + on.y / ${PICTURE_PX}.0 * beside;
  laid = vec2(on.x, appearance.x >> ${2 * PLACE_BITS}u);
#endif
  gl_Position = vec4(2.0 * position.x / size.x - 1.0, 1.0 - 2.0 * position.y / size.y, 0.0, 1.0);
  if (cutoff == 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}
`;

export const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec2 offset;
flat in vec4 colour;
#ifdef LAID
precision highp sampler2DArray;
in vec2 place;
flat in vec2 laid;
uniform sampler2DArray detail; // factors of colours, a layer a person
#endif
out vec4 premultiplied;

/**
 * e^-(r2 / 2), to 5e-5 as far as a splat reaches; beyond, it falls faster, to nil. Half the time of exp
 * where a processor stands in for the card.
 */
float falloff(float r2) {
  float x = 0.0625 * r2;
  float root = max(1.0 + x * (-0.99957052 + x * (0.49235955 - 0.133402 * x)), 0.0);
  root *= root;
  root *= root;
  return root * root;
}

void main() {
  float alpha = min(colour.a * falloff(dot(offset, offset)), ${float(MAX_OPACITY)});
  vec3 rgb = colour.rgb;
#ifdef LAID
  if (laid.x > 0.0 && alpha > ${float(LEAST_LAID)}) {
    vec3 factor = ${float(LARGEST_DETAIL)} * textureLod(detail, vec3(place, laid.y), 0.0).rgb;
    rgb = min(rgb * mix(vec3(1.0), factor, laid.x), 1.0);
  }
#endif
  premultiplied = vec4(rgb * alpha, alpha);
}
`;

export const FULLSCREEN_VERTEX = `#version 300 es
void main() {
  // one triangle that covers everything
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
`;
