/** Draws flat things over the picture of an eye: boards, the ring on the floor, rays. */

import type { Eye, PassCamera } from "../splats/camera";
import { program, uniformsOf, type Uniforms } from "../splats/program";
import { add, cross, scale, unit, type Quad } from "./space";
import type { Vec3 } from "../viewpoint/geometry";

const VERTEX = `#version 300 es
precision highp float;
uniform vec3 middle;
uniform vec3 right;
uniform vec3 up;
uniform mat3 rotation; // world -> camera
uniform vec3 translation;
uniform vec2 focal; // px
uniform vec2 centre;
uniform vec2 size;
out vec2 position; // -1 to 1

void main() {
  position = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  vec3 p = rotation * (middle + position.x * right + position.y * up) + translation;
  vec2 homogeneousPx = focal * p.xy + centre * p.z;
  vec2 clip = 2.0 * homogeneousPx / size - p.z;
  gl_Position = vec4(clip.x, -clip.y, 0.0, p.z);
}
`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2D;
in vec2 position;
uniform int kind; // 0: a board, 1: a ring, 2: a ray that fades away
uniform sampler2D board; // premultiplied
uniform vec3 colour;
out vec4 fragColour;

void main() {
  if (kind == 0) {
    fragColour = texture(board, vec2(0.5 + 0.5 * position.x, 0.5 - 0.5 * position.y));
    return;
  }
  float radius = kind == 1 ? length(position) : abs(position.y);
  float edge = fwidth(radius);
  float alpha = 1.0 - smoothstep(1.0 - edge, 1.0, radius);
  if (kind == 1) alpha *= smoothstep(0.72 - edge, 0.72, radius) + 0.25 * (1.0 - smoothstep(0.25 - edge, 0.25, radius));
  else alpha *= 0.75 - 0.6 * (0.5 + 0.5 * position.x);
  fragColour = vec4(colour * alpha, alpha);
}
`;

const KINDS = { board: 0, ring: 1, ray: 2 } as const;
const RAY_HALF_WIDTH_M = 0.002;
const RING_M = 0.28;

/** A canvas of words, and its copy on the card. */
export class CanvasPanel {
  readonly painter: CanvasRenderingContext2D;
  readonly texture: WebGLTexture;
  private painted = "";

  constructor(
    private readonly gl: WebGL2RenderingContext,
    width: number,
    height: number,
  ) {
    const painter = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d");
    if (!painter) throw new Error("a board takes a canvas to paint on; this browser gave none");
    this.painter = painter;
    this.texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
  }

  /** Paint anew where `key`, all that the picture depends on, is another than last time. */
  show(key: string, paint: (on: CanvasRenderingContext2D) => void): void {
    if (key === this.painted) return;
    this.painted = key;
    paint(this.painter);
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, this.painter.canvas);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.generateMipmap(gl.TEXTURE_2D);
  }
}

/** Something flat in the room. */
export type OverlayQuad = { quad: Quad } & ({ kind: "board"; board: CanvasPanel } | { kind: "ring" | "ray"; colour: Vec3 });

/** A ring on the floor. */
export function ringQuad(middle: Vec3): Quad {
  return { middle, right: [RING_M, 0, 0], up: [0, 0, -RING_M] };
}

/** A thin strip from one point to another that turns its face to `eye`. */
export function rayQuad(from: Vec3, to: Vec3, eye: Vec3): Quad {
  const right = scale(add(to, from, -1), 0.5);
  const middle = add(from, right);
  return { middle, right, up: scale(unit(cross(right, add(eye, middle, -1))), RAY_HALF_WIDTH_M) };
}

export class QuadRenderer {
  private readonly program: WebGLProgram;
  private readonly at: Uniforms;
  private readonly emptyVertexArray: WebGLVertexArrayObject;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.program = program(gl, VERTEX, FRAGMENT);
    this.at = uniformsOf(gl, this.program);
    this.emptyVertexArray = gl.createVertexArray();
  }

  /** Draw over what is there, the last in front. */
  draw({ camera, framebuffer, x, y }: Eye, flats: readonly OverlayQuad[]): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(x, y, camera.width, camera.height);
    gl.useProgram(this.program);
    gl.bindVertexArray(this.emptyVertexArray);
    gl.activeTexture(gl.TEXTURE0);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.setCamera(camera);
    for (const flat of flats) {
      gl.uniform3f(this.at("middle"), ...flat.quad.middle);
      gl.uniform3f(this.at("right"), ...flat.quad.right);
      gl.uniform3f(this.at("up"), ...flat.quad.up);
      gl.uniform1i(this.at("kind"), KINDS[flat.kind]);
      if (flat.kind === "board") gl.bindTexture(gl.TEXTURE_2D, flat.board.texture);
      else gl.uniform3f(this.at("colour"), ...flat.colour);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    gl.disable(gl.BLEND);
  }

  private setCamera({ worldToCamera: m, focalPx, centrePx, width, height }: PassCamera): void {
    const { gl } = this;
    const columns = [0, 1, 2].flatMap((c) => [m[c] ?? 0, m[4 + c] ?? 0, m[8 + c] ?? 0]);
    gl.uniformMatrix3fv(this.at("rotation"), false, columns);
    gl.uniform3f(this.at("translation"), m[3] ?? 0, m[7] ?? 0, m[11] ?? 0);
    gl.uniform2f(this.at("focal"), ...focalPx);
    gl.uniform2f(this.at("centre"), ...centrePx);
    gl.uniform2f(this.at("size"), width, height);
  }
}
