/**
 * GLSL of the splat pass. It follows the server's rasteriser (renderer/splats/project_kernels.py and
 * tile_kernels.py) and backdrop (renderer/backdrop_kernels.py) formula by formula; a test compares
 * their pictures.
 *
 * Letters: M = sum_k w_k T_k the blended transform, p = R M x + t the camera point, J the perspective's
 * Jacobian; the covariance on the picture is J R A V A^T R^T J^T + pixel filter (EWA splatting,
 * Zwicker et al. 2001).
 */

import { NEAR_M, ORDER_COLUMNS } from "./sort";

/** Variance of a pixel's box filter, px^2: BOX_FILTER_PX2 of the server. */
const PIXEL_FILTER_PX2 = 1 / 12;
/** Opacity below which a splat changes no 8-bit pixel. */
const FAINTEST = 1 / 255;
const MOST_OPAQUE = 0.99;
/** Factor of variances where only what was filmed is shown, as renderer/splats/unseen.py widens. */
const WIDER = Math.exp(2 * 0.3);
/** Splats a row of the table; four texels each. */
export const TABLE_COLUMNS = 256;
/** People of a meeting, two ankles each. */
export const MOST_SHADOWS = 24;

const float = (value: number): string => value.toFixed(9);

export const SPLAT_VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;

uniform usampler2D table;
uniform usampler2D order;
uniform sampler2D transforms;
uniform mat3 rotation; // world -> camera
uniform vec3 translation;
uniform vec2 focal; // px
uniform vec2 centre;
uniform vec2 size;
uniform bool filmedOnly;
out vec2 away; // from the middle, in standard deviations
out vec4 colour;

vec4 row(uint joint, int r) {
  return texelFetch(transforms, ivec2(r, int(joint)), 0);
}

void main() {
  // four corners a splat: instances are drawn one by one where a processor stands in for the card
  int nth = gl_VertexID >> 2;
  uint splat = texelFetch(order, ivec2(nth % ${ORDER_COLUMNS}, nth / ${ORDER_COLUMNS}), 0).x;
  vec2 corner = vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) * 2.0 - 1.0;
  ivec2 at = ivec2(4 * int(splat % ${TABLE_COLUMNS}u), int(splat / ${TABLE_COLUMNS}u));
  uvec4 t0 = texelFetch(table, at, 0);
  uvec4 t1 = texelFetch(table, at + ivec2(1, 0), 0);
  uvec4 t2 = texelFetch(table, at + ivec2(2, 0), 0);
  uvec4 t3 = texelFetch(table, at + ivec2(3, 0), 0);
  vec4 x = vec4(uintBitsToFloat(t0.xyz), 1.0);
  vec4 v = uintBitsToFloat(t1);
  vec2 w = uintBitsToFloat(t2.xy);
  uvec4 joints = uvec4(t0.w & 0xffffu, t0.w >> 16u, t2.z & 0xffffu, t2.z >> 16u);
  uvec4 weights = (uvec4(t2.w) >> uvec4(0u, 8u, 16u, 24u)) & 0xffu;
  float opacity = float(t3.w & 0xffu) / 255.0;
  colour.rgb = uintBitsToFloat(t3.xyz);
  mat3 covariance = mat3(v.x, v.y, v.z, v.y, v.w, w.x, v.z, w.x, w.y);
  if (filmedOnly) {
    opacity *= float((t3.w >> 8u) & 0xffu) / 255.0;
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
  vec3 p = rotation * vec3(dot(m0, x), dot(m1, x), dot(m2, x)) + translation;
  mat3 turn = rotation * transpose(mat3(m0.xyz, m1.xyz, m2.xyz));
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (p.z <= ${float(NEAR_M)} || opacity <= ${float(FAINTEST)}) return;

  vec2 plane = focal / p.z;
  vec3 across = vec3(plane.x, 0.0, -plane.x * p.x / p.z) * turn;
  vec3 down = vec3(0.0, plane.y, -plane.y * p.y / p.z) * turn;
  float xx = dot(across, covariance * across) + ${float(PIXEL_FILTER_PX2)};
  float xy = dot(across, covariance * down);
  float yy = dot(down, covariance * down) + ${float(PIXEL_FILTER_PX2)};
  float middle = 0.5 * (xx + yy);
  float apart = length(vec2(0.5 * (xx - yy), xy));
  float longest = middle + apart;
  float shortest = max(middle - apart, ${float(PIXEL_FILTER_PX2)});
  vec2 axis = abs(xy) > 1e-6 ? normalize(vec2(longest - yy, xy)) : (xx >= yy ? vec2(1.0, 0.0) : vec2(0.0, 1.0));
  away = corner * sqrt(2.0 * log(opacity / ${float(FAINTEST)}));
  vec2 pixel = plane * p.xy + centre + axis * (sqrt(longest) * away.x)
    + vec2(-axis.y, axis.x) * (sqrt(shortest) * away.y);
  colour.a = opacity;
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
}
`;

export const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec2 away;
in vec4 colour;
out vec4 premultiplied;

void main() {
  float alpha = min(colour.a * exp(-0.5 * dot(away, away)), ${float(MOST_OPAQUE)});
  premultiplied = vec4(colour.rgb * alpha, alpha);
}
`;

export const ROOM_VERTEX = `#version 300 es
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
uniform vec3 horizon;
uniform vec3 zenith;
uniform vec3 floorColour;
uniform int shadowCount;
uniform vec4 shadows[${MOST_SHADOWS}]; // x, z, radius (m), strength
out vec4 shown;

const float FADE_M = 14.0;
const float LINE_HALF_WIDTH_M = 0.008;
const float LINE_DARKNESS = 0.16;

/** Share of a pixel as wide as the footprint (m) that the nearest metre line covers. */
vec2 lineCoverage(vec2 x, float footprint) {
  vec2 edge = (LINE_HALF_WIDTH_M - abs(x - floor(x + 0.5))) / footprint + 0.5;
  return clamp(edge, 0.0, 1.0) * min(1.0, 2.0 * LINE_HALF_WIDTH_M / footprint);
}

vec3 room(vec2 pixel) {
  vec3 ray = vec3((pixel - centre) / focal, 1.0) * rotation;
  float norm = 1.0 / length(ray);
  if (ray.y < -1e-6 && eye.y > 0.0) {
    float reach = -eye.y / ray.y;
    vec2 ground = eye.xz + reach * ray.xz;
    float far = reach / norm;
    float footprint = far / focal.y / max(-ray.y * norm, 0.05) + 1e-6;
    vec2 cover = lineCoverage(ground, footprint);
    float light = 1.0 - LINE_DARKNESS * max(cover.x, cover.y);
    for (int s = 0; s < shadowCount; s++) {
      vec2 off = ground - shadows[s].xy;
      float spread = dot(off, off) / (shadows[s].z * shadows[s].z);
      if (spread < 12.0) light *= 1.0 - shadows[s].w * exp(-spread);
    }
    return mix(horizon, floorColour * light, exp(-far / FADE_M));
  }
  return mix(horizon, zenith, sqrt(max(ray.y * norm, 0.0)));
}

void main() {
  vec4 front = texelFetch(people, ivec2(gl_FragCoord.xy), 0);
  vec3 behind = vec3(0.0);
  if (front.a < 0.999) behind = room(vec2(gl_FragCoord.x, size.y - gl_FragCoord.y));
  shown = vec4(front.rgb + (1.0 - front.a) * behind, 1.0);
}
`;
