/**
 * GLSL of the splat pass. It follows the server's rasteriser (renderer/splats/rasteriser/projection_kernels.py and
 * tile_kernels.py), light (renderer/relighting/shading_kernels.py) and backdrops (renderer/compositing/backdrop_kernels.py,
 * panorama_kernels.py) formula by formula; a test compares their pictures.
 *
 * Letters: M = sum_k w_k T_k the blended transform, p = R M x + t the camera point, J the perspective's
 * Jacobian; the covariance on the picture is J R A V A^T R^T J^T + pixel filter (EWA splatting,
 * Zwicker et al. 2001). Each splat is placed in the picture once, into a texture in the order of
 * drawing; the four corners of its quad only read that. On a phone's card, which runs vertices twice,
 * and on a processor, where they are dear, that is most of what splats cost.
 */

import { OWNER_BITS } from "./packed";
import { MOVED_COLUMNS } from "./moved";
import { NEAR_M, ORDER_COLUMNS } from "./sort";

/** Variance of a pixel's box filter, px^2: BOX_FILTER_PX2 of the server. */
const PIXEL_FILTER_PX2 = 1 / 12;
/** Determinant of a covariance from which a splat counts as no smaller, px^4: LEAST_AREA_PX4. */
const LEAST_AREA_PX4 = 1e-6;
/** Opacity below which a splat changes no 8-bit pixel. */
const MIN_OPACITY = 1 / 255;
const MAX_OPACITY = 0.99;
/** Factor of variances where only what was filmed is shown, as renderer/splats/unseen.py widens. */
const WIDER = Math.exp(2 * 0.3);
/** Splats a row of the table; four texels each. */
export const TABLE_COLUMNS = 256;
/** People of a meeting. */
export const MAX_PEOPLE = 12;
/** Two ankles each. */
export const MAX_SHADOWS = 2 * MAX_PEOPLE;

const float = (value: number): string => value.toFixed(9);

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
uniform mat3 rotation; // world -> camera
uniform vec3 translation;
uniform vec2 focal; // px
uniform vec2 centre;
uniform vec2 size;
uniform bool filmedOnly;
uniform vec3 eye; // m
uniform bool lit[${MAX_PEOPLE}]; // by the room or as in their clip; else in the mean colours of that
uniform vec3 harmonics[9 * ${MAX_PEOPLE}];
uniform vec2 turned[${MAX_PEOPLE}]; // cosine and sine of the yaw by which that light was turned
uniform vec3 keyDirection;
uniform vec3 keyColour;
uniform float growth[${MAX_PEOPLE}]; // of variances, a person
layout(location = 0) out uvec4 middle; // of the ellipse, px, and its long half axis at one deviation
layout(location = 1) out uvec4 look; // short over long axis, reach in deviations (0: unseen), colour

vec4 row(uint joint, int r) {
  return texelFetch(transforms, ivec2(r, int(joint)), 0);
}

vec3 bytes(uint packed) {
  return vec3((uvec3(packed) >> uvec3(0u, 8u, 16u)) & 0xffu) / 255.0;
}

vec3 normalOf(uint packed) {
  return vec3((ivec3(int(packed)) << ivec3(24, 16, 8)) >> 24);
}

vec3 toLinear(vec3 srgb) {
  return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), step(0.04045, srgb));
}

vec3 toSrgb(vec3 light) {
  vec3 c = clamp(light, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

/** sRGB of an albedo (sRGB) on somebody's surface that faces n, seen from v further on. */
vec3 relit(uint who, vec3 albedo, vec3 n, vec3 v) {
  n *= inversesqrt(max(dot(n, n), 1e-12));
  // what shines through from the far side stands for what lies before it
  float away = dot(n, v);
  if (away < 0.0) n -= 2.0 * away / max(dot(v, v), 1e-12) * v;
  vec3 key = max(dot(n, keyDirection), 0.0) * keyColour;
  vec2 way = turned[who];
  n.xz = vec2(way.x * n.x - way.y * n.z, way.y * n.x + way.x * n.z);
  uint h = 9u * who;
  vec3 light = 0.282095 * harmonics[h]
    + 0.488603 * (n.y * harmonics[h + 1u] + n.z * harmonics[h + 2u] + n.x * harmonics[h + 3u])
    + 1.092548 * (n.x * n.y * harmonics[h + 4u] + n.y * n.z * harmonics[h + 5u] + n.x * n.z * harmonics[h + 7u])
    + 0.315392 * (3.0 * n.z * n.z - 1.0) * harmonics[h + 6u]
    + 0.546274 * (n.x * n.x - n.y * n.y) * harmonics[h + 8u];
  light = max(light, 0.0) + key;
  return toSrgb(toLinear(albedo) * light);
}

void main() {
  middle = look = uvec4(0u);
  uint splat = texelFetch(order, ivec2(gl_FragCoord.xy), 0).x;
  ivec2 at = ivec2(4 * int(splat % ${TABLE_COLUMNS}u), int(splat / ${TABLE_COLUMNS}u));
  uvec4 t0 = texelFetch(table, at, 0);
  uvec4 t1 = texelFetch(table, at + ivec2(1, 0), 0);
  uvec4 t2 = texelFetch(table, at + ivec2(2, 0), 0);
  uvec4 t3 = texelFetch(table, at + ivec2(3, 0), 0);
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
  if (filmedOnly) {
    opacity *= float(t3.x >> 24u) / 255.0;
    covariance *= ${float(WIDER)};
  }

  vec4 m0 = vec4(0.0), m1 = vec4(0.0), m2 = vec4(0.0);
  for (int k = 0; k < 4; k++) {
    if (weights[k] == 0u) continue;
    float weight = float(weights[k]) / 255.0;
    m0 += weight * row(joints[k], 0);
    m1 += weight * row(joints[k], 1);
    m2 += weight * row(joints[k], 2);
  }
  vec3 place = vec3(dot(m0, x), dot(m1, x), dot(m2, x));
  vec3 p = rotation * place + translation;
  mat3 turn = rotation * transpose(mat3(m0.xyz, m1.xyz, m2.xyz));
  if (p.z <= ${float(NEAR_M)} || opacity <= ${float(MIN_OPACITY)}) return;

  vec2 plane = focal / p.z;
  vec3 across = vec3(plane.x, 0.0, -plane.x * p.x / p.z) * turn;
  vec3 down = vec3(0.0, plane.y, -plane.y * p.y / p.z) * turn;
  float xx = dot(across, covariance * across) + ${float(PIXEL_FILTER_PX2)};
  float xy = dot(across, covariance * down);
  float yy = dot(down, covariance * down) + ${float(PIXEL_FILTER_PX2)};
  float bare = (xx - ${float(PIXEL_FILTER_PX2)}) * (yy - ${float(PIXEL_FILTER_PX2)}) - xy * xy;
  opacity *= sqrt(max(bare, ${float(LEAST_AREA_PX4)}) / (xx * yy - xy * xy));
  if (opacity <= ${float(MIN_OPACITY)}) return;
  float mean = 0.5 * (xx + yy);
  float apart = length(vec2(0.5 * (xx - yy), xy));
  float longest = mean + apart;
  float shortest = max(mean - apart, ${float(PIXEL_FILTER_PX2)});
  vec2 axis = abs(xy) > 1e-6 ? normalize(vec2(longest - yy, xy)) : (xx >= yy ? vec2(1.0, 0.0) : vec2(0.0, 1.0));
  float reach = sqrt(2.0 * log(opacity / ${float(MIN_OPACITY)}));
  vec2 pixel = plane * p.xy + centre;
  float extent = reach * sqrt(longest);
  // what lies wholly beside the picture costs no quad
  if (any(lessThan(pixel, vec2(-extent))) || any(greaterThan(pixel, size + extent))) return;
  vec3 rgb = bytes(t3.x);
  if (lit[owner]) {
    vec3 normal = normalOf(t3.z) * mat3(m0.xyz, m1.xyz, m2.xyz);
    rgb = relit(owner, bytes(t3.y), normal, eye - place);
  }
  middle = floatBitsToUint(vec4(pixel, axis * sqrt(longest)));
  look = uvec4(
    floatBitsToUint(sqrt(shortest / longest)), floatBitsToUint(reach),
    packHalf2x16(rgb.rg), packHalf2x16(vec2(rgb.b, opacity))
  );
}
`;

export const SPLAT_VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;

uniform usampler2D middles;
uniform usampler2D looks;
uniform vec2 size;
out vec2 away; // from the middle, in standard deviations
flat out vec4 colour;

void main() {
  // four corners a splat: instances are drawn one by one where a processor stands in for the card
  int nth = gl_VertexID >> 2;
  ivec2 at = ivec2(nth % ${ORDER_COLUMNS}, nth / ${ORDER_COLUMNS});
  vec4 middle = uintBitsToFloat(texelFetch(middles, at, 0));
  uvec4 look = texelFetch(looks, at, 0);
  float reach = uintBitsToFloat(look.y);
  away = reach * (vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) * 2.0 - 1.0);
  colour = vec4(unpackHalf2x16(look.z), unpackHalf2x16(look.w));
  vec2 axis = middle.zw;
  vec2 pixel = middle.xy + away.x * axis + away.y * uintBitsToFloat(look.x) * vec2(-axis.y, axis.x);
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
  if (reach == 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}
`;

export const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec2 away;
flat in vec4 colour;
out vec4 premultiplied;

void main() {
  float alpha = min(colour.a * exp(-0.5 * dot(away, away)), ${float(MAX_OPACITY)});
  premultiplied = vec4(colour.rgb * alpha, alpha);
}
`;

export const FULLSCREEN_VERTEX = `#version 300 es
void main() {
  // one triangle that covers everything
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
`;

export const ROOM_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2D;

uniform sampler2D people; // premultiplied
uniform mat3 rotation; // world -> camera
uniform vec3 eye;
uniform vec2 focal;
uniform vec2 centre;
uniform vec2 size;
uniform vec2 corner; // of the picture in its framebuffer, px
uniform vec3 horizon;
uniform vec3 zenith;
uniform vec3 floorColour;
uniform bool panoramic; // the place that a panorama shows; else the studio
uniform sampler2D panorama; // equirectangular, sRGB
uniform bool sharing; // a screen stands in the room
uniform sampler2D screen; // sRGB, the top row first
uniform vec3 screenCentre; // m
uniform vec2 screenHalves; // m
uniform int shadowCount;
uniform vec4 shadows[${MAX_SHADOWS}]; // x, z, radius (m), strength
out vec4 shown;

const float FADE_M = 14.0;
const float LINE_HALF_WIDTH_M = 0.008;
const float LINE_DARKNESS = 0.16;
/** Where a panorama was taken, and the dome that it is laid on, m. */
const float TAKEN_AT_M = 1.6;
const float DOME_M = 8.0;
const float PI = 3.14159265358979;
const float SCREEN_BACK = 0.12;

/** Share of a pixel as wide as the footprint (m) that the nearest metre line covers. */
vec2 lineCoverage(vec2 x, float footprint) {
  vec2 edge = (LINE_HALF_WIDTH_M - abs(x - floor(x + 0.5))) / footprint + 0.5;
  return clamp(edge, 0.0, 1.0) * min(1.0, 2.0 * LINE_HALF_WIDTH_M / footprint);
}

/** What soft shadows leave of the light at x, z on the floor. */
float unshaded(vec2 ground) {
  float light = 1.0;
  for (int s = 0; s < shadowCount; s++) {
    vec2 off = ground - shadows[s].xy;
    float spread = dot(off, off) / (shadows[s].z * shadows[s].z);
    if (spread < 12.0) light *= 1.0 - shadows[s].w * exp(-spread);
  }
  return light;
}

vec3 place(vec3 ray) {
  vec3 met = vec3(0.0);
  float light = 1.0;
  bool onFloor = false;
  if (ray.y < -1e-6 && eye.y > 0.0) {
    vec2 ground = eye.xz - eye.y / ray.y * ray.xz;
    onFloor = dot(ground, ground) < DOME_M * DOME_M - TAKEN_AT_M * TAKEN_AT_M;
    met = vec3(ground.x, -TAKEN_AT_M, ground.y);
    if (onFloor) light = unshaded(ground);
  }
  if (!onFloor) {
    // the farther crossing of the dome
    vec3 from = eye - vec3(0.0, TAKEN_AT_M, 0.0);
    float a = dot(ray, ray), h = dot(from, ray), rest = dot(from, from) - DOME_M * DOME_M;
    met = from + (sqrt(max(h * h - a * rest, 0.0)) - h) / a * ray;
  }
  float rows = float(textureSize(panorama, 0).y);
  float v = 0.5 - atan(met.y, length(met.xz)) / PI;
  vec2 at = vec2(0.5 + atan(met.z, met.x) / (2.0 * PI), clamp(v, 0.5 / rows, 1.0 - 0.5 / rows));
  return light * textureLod(panorama, at, 0.0).rgb;
}

/** Where on the shared screen the ray meets it: from -1 to 1; outside of that where it does not. */
vec2 onScreen(vec3 ray) {
  float reach = (screenCentre.z - eye.z) / ray.z;
  return reach > 0.0 ? (eye.xy + reach * ray.xy - screenCentre.xy) / screenHalves : vec2(2.0);
}

vec3 room(vec3 ray) {
  if (panoramic) return place(ray);
  float norm = 1.0 / length(ray);
  if (ray.y < -1e-6 && eye.y > 0.0) {
    float reach = -eye.y / ray.y;
    vec2 ground = eye.xz + reach * ray.xz;
    float far = reach / norm;
    float footprint = far / focal.y / max(-ray.y * norm, 0.05) + 1e-6;
    vec2 cover = lineCoverage(ground, footprint);
    float light = (1.0 - LINE_DARKNESS * max(cover.x, cover.y)) * unshaded(ground);
    return mix(horizon, floorColour * light, exp(-far / FADE_M));
  }
  return mix(horizon, zenith, sqrt(max(ray.y * norm, 0.0)));
}

void main() {
  vec2 place = gl_FragCoord.xy - corner;
  vec4 front = texelFetch(people, ivec2(place), 0);
  vec3 ray = vec3((vec2(place.x, size.y - place.y) - centre) / focal, 1.0) * rotation;
  vec2 at = sharing ? onScreen(ray) : vec2(2.0);
  bool met = max(abs(at.x), abs(at.y)) < 1.0;
  // whoever looks from behind sees its back, and nobody through it
  if (met && ray.z > 0.0) {
    shown = vec4(vec3(SCREEN_BACK), 1.0);
    return;
  }
  vec3 behind = vec3(0.0);
  if (front.a < 0.999) behind = met ? textureLod(screen, 0.5 + vec2(0.5, -0.5) * at, 0.0).rgb : room(ray);
  shown = vec4(front.rgb + (1.0 - front.a) * behind, 1.0);
}
`;
