/**
 * Draws a cast of skinned splats over the room, in WebGL2: splats front to back into a picture of
 * their own (premultiplied, each hiding the others rightly), then that over the backdrop.
 *
 * Eight bits a channel: half floats bring 58 dB against the server's picture where these bring 52,
 * which nobody sees, cost twice the time where a processor stands in for the card, and not every
 * phone blends into them.
 */

import { SPLAT_NUMBERS, type Cast } from "./cast";
import { matrixOf } from "./file";
import { ORDER_COLUMNS } from "./sort";
import {
  MOST_SHADOWS,
  ROOM_FRAGMENT,
  ROOM_VERTEX,
  SPLAT_FRAGMENT,
  SPLAT_VERTEX,
  TABLE_COLUMNS,
} from "./shaders";
import { STUDIO, type Shadow } from "./room";
import type { CameraPose } from "../viewpoint";

/** A pinhole camera in the room, OpenCV axes. */
export interface PassCamera {
  /** R and t of world -> camera: three rows of four numbers. */
  worldToCamera: Float32Array;
  eye: readonly [number, number, number];
  /** px; square pixels, principal point in the middle. */
  focalPx: number;
  width: number;
  height: number;
}

export function passCamera(pose: CameraPose, fovYRad: number, width: number, height: number): PassCamera {
  const turn = matrixOf(pose.wxyz); // camera -> world
  const worldToCamera = new Float32Array(12);
  for (let r = 0; r < 3; r++) {
    for (let c = 0; c < 3; c++) {
      const value = turn[3 * c + r] ?? 0;
      worldToCamera[4 * r + c] = value;
      worldToCamera[4 * r + 3] = (worldToCamera[4 * r + 3] ?? 0) - value * (pose.position[c] ?? 0);
    }
  }
  const [x, y, z] = pose.position;
  return { worldToCamera, eye: [x, y, z], focalPx: (0.5 * height) / Math.tan(0.5 * fovYRad), width, height };
}

/** What changes from picture to picture. */
export interface PassFrame {
  camera: PassCamera;
  /** A transform a joint of the cast, one person after the other. */
  transforms: Float32Array;
  /** Splats by rising depth, of which the first `count` are drawn. */
  order: Uint32Array;
  count: number;
  shadows: readonly Shadow[];
  filmedOnly: boolean;
}

/** Corners of two triangles that share an edge. */
const TRIANGLES = [0, 1, 2, 2, 1, 3];

type Uniforms = (name: string) => WebGLUniformLocation | null;

export class SplatPass {
  private readonly gl: WebGL2RenderingContext;
  private readonly splats: WebGLProgram;
  private readonly room: WebGLProgram;
  private readonly splatUniforms: Uniforms;
  private readonly roomUniforms: Uniforms;
  /** Four corners a splat as two triangles. */
  private readonly corners: WebGLVertexArrayObject;
  private readonly nothing: WebGLVertexArrayObject;
  private readonly order: WebGLTexture;
  private readonly table: WebGLTexture;
  private readonly transforms: WebGLTexture;
  private readonly picture: WebGLTexture;
  private readonly target: WebGLFramebuffer;
  private orderOnCard: Uint32Array | null = null;
  private size = { width: 0, height: 0 };

  /** Throws where the browser has no WebGL2. */
  constructor(canvas: HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error("drawing takes WebGL2; this browser has none");
    this.gl = gl;
    this.splats = program(gl, SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.room = program(gl, ROOM_VERTEX, ROOM_FRAGMENT);
    this.splatUniforms = (name) => gl.getUniformLocation(this.splats, name);
    this.roomUniforms = (name) => gl.getUniformLocation(this.room, name);
    this.table = texture(gl);
    this.transforms = texture(gl);
    this.picture = texture(gl);
    this.target = gl.createFramebuffer();
    this.order = texture(gl);
    this.corners = gl.createVertexArray();
    this.nothing = gl.createVertexArray();
    gl.bindVertexArray(this.corners);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  }

  /** Hand over the splats; they stay on the card. */
  setCast(cast: Cast): void {
    const { gl } = this;
    const rows = Math.max(1, Math.ceil(cast.count / TABLE_COLUMNS));
    const padded = new Uint32Array(rows * TABLE_COLUMNS * SPLAT_NUMBERS);
    padded.set(cast.table);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.texImage2D(
      gl.TEXTURE_2D, 0, gl.RGBA32UI, 4 * TABLE_COLUMNS, rows, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, padded,
    );
    const triangles = new Uint32Array(6 * cast.count);
    for (let i = 0; i < cast.count; i++) triangles.set(TRIANGLES.map((corner) => 4 * i + corner), 6 * i);
    gl.bindVertexArray(this.corners);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
    this.orderOnCard = null;
  }

  /** Draw into the canvas, which takes the size of the camera's picture. */
  draw(frame: PassFrame): void {
    this.resize(frame.camera);
    this.drawSplats(frame);
    this.drawRoom(frame);
  }

  /** What the canvas shows, RGBA bytes, the top row first; also waits until everything is drawn. */
  read(rows = this.size.height): Uint8Array {
    const { gl, size } = this;
    const bytes = new Uint8Array(4 * size.width * rows);
    gl.readPixels(0, size.height - rows, size.width, rows, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    const line = 4 * size.width;
    const upright = new Uint8Array(bytes.length);
    for (let row = 0; row < rows; row++) {
      upright.set(bytes.subarray(row * line, (row + 1) * line), (rows - 1 - row) * line);
    }
    return upright;
  }

  /** Give the card's memory back. */
  close(): void {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  private drawSplats({ camera, transforms, order, count, filmedOnly }: PassFrame): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(this.splats);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.transforms);
    gl.texImage2D(
      gl.TEXTURE_2D, 0, gl.RGBA32F, 3, transforms.length / 12, 0, gl.RGBA, gl.FLOAT, transforms,
    );
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.uniform1i(this.splatUniforms("transforms"), 1);
    gl.uniform1i(this.splatUniforms("filmedOnly"), filmedOnly ? 1 : 0);
    this.setCamera(this.splatUniforms, camera);
    const t = camera.worldToCamera;
    gl.uniform3f(this.splatUniforms("translation"), t[3] ?? 0, t[7] ?? 0, t[11] ?? 0);
    gl.activeTexture(gl.TEXTURE2);
    gl.bindTexture(gl.TEXTURE_2D, this.order);
    if (this.orderOnCard !== order) {
      const rows = order.length / ORDER_COLUMNS;
      gl.texImage2D(
        gl.TEXTURE_2D, 0, gl.R32UI, ORDER_COLUMNS, rows, 0, gl.RED_INTEGER, gl.UNSIGNED_INT, order,
      );
      this.orderOnCard = order;
    }
    gl.uniform1i(this.splatUniforms("order"), 2);
    gl.bindVertexArray(this.corners);
    gl.enable(gl.BLEND);
    // front to back: each splat gets what the ones before it let through
    gl.blendFunc(gl.ONE_MINUS_DST_ALPHA, gl.ONE);
    gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 0);
    gl.disable(gl.BLEND);
  }

  private drawRoom({ camera, shadows }: PassFrame): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.useProgram(this.room);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    this.setCamera(this.roomUniforms, camera);
    gl.uniform3f(this.roomUniforms("eye"), ...camera.eye);
    gl.uniform3f(this.roomUniforms("horizon"), ...STUDIO.horizon);
    gl.uniform3f(this.roomUniforms("zenith"), ...STUDIO.zenith);
    gl.uniform3f(this.roomUniforms("floorColour"), ...STUDIO.floor);
    const kept = shadows.slice(0, MOST_SHADOWS);
    gl.uniform1i(this.roomUniforms("shadowCount"), kept.length);
    if (kept.length > 0) gl.uniform4fv(this.roomUniforms("shadows"), kept.flat());
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  private setCamera(uniforms: Uniforms, camera: PassCamera): void {
    const { gl } = this;
    const m = camera.worldToCamera;
    const columns = [0, 1, 2].flatMap((c) => [m[c] ?? 0, m[4 + c] ?? 0, m[8 + c] ?? 0]);
    gl.uniformMatrix3fv(uniforms("rotation"), false, columns);
    gl.uniform2f(uniforms("focal"), camera.focalPx, camera.focalPx);
    gl.uniform2f(uniforms("centre"), 0.5 * camera.width, 0.5 * camera.height);
    gl.uniform2f(uniforms("size"), camera.width, camera.height);
  }

  private resize({ width, height }: PassCamera): void {
    const { gl, size } = this;
    if (size.width === width && size.height === height) return;
    this.size = { width, height };
    gl.canvas.width = width;
    gl.canvas.height = height;
    gl.viewport(0, 0, width, height);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.picture, 0);
  }
}

function texture(gl: WebGL2RenderingContext): WebGLTexture {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
    gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  }
  return made;
}

function program(gl: WebGL2RenderingContext, vertex: string, fragment: string): WebGLProgram {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]] as const) {
    const shader = gl.createShader(kind);
    if (!shader) throw new Error("the graphics card has gone away");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) {
    const logs = gl.getAttachedShaders(made)?.map((shader) => gl.getShaderInfoLog(shader)) ?? [];
    throw new Error(`the shaders must compile; got ${[gl.getProgramInfoLog(made), ...logs].join(" ")}`);
  }
  return made;
}
