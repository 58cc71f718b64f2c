/**
 * GLSL of the room behind everybody. It follows the server's backdrops (renderer/compositing/backdrop_kernels.py and
 * panorama_kernels.py) formula by formula; a test compares their pictures.
 *
 * A program for each kind of room: a processor that stands in for the card works out both sides of
 * every branch, and shadows alone cost as much as all else of the studio.
 */

import { SHADOW_SPREAD } from "./room";
import { MAX_PEOPLE } from "./shaders";

/** Two ankles each. */
export const MAX_SHADOWS = 2 * MAX_PEOPLE;

export interface RoomKind {
  /** The place that a panorama shows; else the studio. */
  panoramic: boolean;
  /** A screen stands in the room. */
  sharing: boolean;
  /** Shadows fall on the floor. */
  shadowed: boolean;
}

export function roomFragment({ panoramic, sharing, shadowed }: RoomKind): string {
  const named = { PANORAMIC: panoramic, SHARING: sharing, SHADOWED: shadowed };
  const defines = Object.entries(named).flatMap(([name, is]) => (is ? [`#define ${name}\n`] : []));
  return `#version 300 es\n${defines.join("")}${FRAGMENT}`;
}

const FRAGMENT = `precision highp float;
precision highp sampler2D;

uniform sampler2D people; // premultiplied
uniform mat3 rotation; // world -> camera
uniform vec3 eye;
uniform vec2 focal;
uniform vec2 centre;
uniform vec2 size;
uniform vec2 viewportOrigin; // of the picture in its framebuffer, px
uniform vec3 horizon;
uniform vec3 zenith;
uniform vec3 floorColour;
uniform sampler2D panorama; // equirectangular, sRGB
uniform sampler2D screen; // sRGB, the top row first
uniform vec3 screenCentre; // m
uniform vec2 screenFacing; // x and z of the way that it faces, a unit vector
uniform vec2 screenHalfSize; // m
uniform int shadowCount;
uniform vec4 shadows[${MAX_SHADOWS}]; // x, z, radius (m), strength
out vec4 fragColour;

const float FADE_M = 14.0;
const float LINE_HALF_WIDTH_M = 0.008;
const float LINE_DARKNESS = 0.16;
/** Where a panorama was taken, and the dome that it is laid on, m. */
const float PANORAMA_HEIGHT_M = 1.6;
const float DOME_RADIUS_M = 8.0;
const float PI = 3.14159265358979;
const float SCREEN_BACK = 0.12;

/** What soft shadows leave of the light at x, z on the floor. */
float shadowTransmittance(vec2 ground) {
  float transmittance = 1.0;
#ifdef SHADOWED
  for (int s = 0; s < shadowCount; s++) {
    vec2 offset = ground - shadows[s].xy;
    float squaredRadii = dot(offset, offset) / (shadows[s].z * shadows[s].z);
    if (squaredRadii < ${SHADOW_SPREAD.toFixed(1)}) transmittance *= 1.0 - shadows[s].w * exp(-squaredRadii);
  }
#endif
  return transmittance;
}

#ifdef PANORAMIC
vec3 roomColour(vec3 ray) {
  vec3 hit = vec3(0.0);
  float light = 1.0;
  bool onFloor = false;
  if (ray.y < -1e-6 && eye.y > 0.0) {
    vec2 ground = eye.xz - eye.y / ray.y * ray.xz;
    onFloor = dot(ground, ground) < DOME_RADIUS_M * DOME_RADIUS_M - PANORAMA_HEIGHT_M * PANORAMA_HEIGHT_M;
    hit = vec3(ground.x, -PANORAMA_HEIGHT_M, ground.y);
    if (onFloor) light = shadowTransmittance(ground);
  }
  if (!onFloor) {
    // the farther crossing of the dome
    vec3 from = eye - vec3(0.0, PANORAMA_HEIGHT_M, 0.0);
    float a = dot(ray, ray), h = dot(from, ray), rest = dot(from, from) - DOME_RADIUS_M * DOME_RADIUS_M;
    hit = from + (sqrt(max(h * h - a * rest, 0.0)) - h) / a * ray;
  }
  float rows = float(textureSize(panorama, 0).y);
  float v = 0.5 - atan(hit.y, length(hit.xz)) / PI;
  vec2 at = vec2(0.5 + atan(hit.z, hit.x) / (2.0 * PI), clamp(v, 0.5 / rows, 1.0 - 0.5 / rows));
  return light * textureLod(panorama, at, 0.0).rgb;
}
#else
/** Share of a pixel as wide as the footprint (m) that the nearest metre line covers. */
vec2 lineCoverage(vec2 x, float footprint) {
  vec2 edge = (LINE_HALF_WIDTH_M - abs(x - floor(x + 0.5))) / footprint + 0.5;
  return clamp(edge, 0.0, 1.0) * min(1.0, 2.0 * LINE_HALF_WIDTH_M / footprint);
}

vec3 roomColour(vec3 ray) {
  float norm = 1.0 / length(ray);
  if (ray.y < -1e-6 && eye.y > 0.0) {
    float t = -eye.y / ray.y;
    vec2 ground = eye.xz + t * ray.xz;
    float depth = t / norm;
    float footprint = depth / focal.y / max(-ray.y * norm, 0.05) + 1e-6;
    vec2 coverage = lineCoverage(ground, footprint);
    float light = (1.0 - LINE_DARKNESS * max(coverage.x, coverage.y)) * shadowTransmittance(ground);
    return mix(horizon, floorColour * light, exp(-depth / FADE_M));
  }
  return mix(horizon, zenith, sqrt(max(ray.y * norm, 0.0)));
}
#endif

#ifdef SHARING
/** Where on the shared screen the ray meets it: from -1 to 1; outside of that where it does not. */
vec2 screenPoint(vec3 ray) {
  float t = dot(screenCentre.xz - eye.xz, screenFacing) / dot(ray.xz, screenFacing);
  vec3 from = eye + t * ray - screenCentre;
  vec2 right = vec2(screenFacing.y, -screenFacing.x);
  return t > 0.0 ? vec2(dot(from.xz, right), from.y) / screenHalfSize : vec2(2.0);
}
#endif

void main() {
  vec2 pixel = gl_FragCoord.xy - viewportOrigin;
  vec4 foreground = texelFetch(people, ivec2(pixel), 0);
  vec3 ray = vec3((vec2(pixel.x, size.y - pixel.y) - centre) / focal, 1.0) * rotation;
#ifdef SHARING
  vec2 at = screenPoint(ray);
  bool hit = max(abs(at.x), abs(at.y)) < 1.0;
  // whoever looks from behind sees its back, and nobody through it
  if (hit && ray.z > 0.0) {
    fragColour = vec4(vec3(SCREEN_BACK), 1.0);
    return;
  }
#endif
  vec3 background = vec3(0.0);
  if (foreground.a < 0.999) {
#ifdef SHARING
    background = hit ? textureLod(screen, 0.5 + vec2(0.5, -0.5) * at, 0.0).rgb : roomColour(ray);
#else
    background = roomColour(ray);
#endif
  }
  fragColour = vec4(foreground.rgb + (1.0 - foreground.a) * background, 1.0);
}
`;
