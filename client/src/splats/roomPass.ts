/** Draws the room behind a picture of people: once without shadows, then where shadows may fall. */

import type { Eye } from "./camera";
import { program, setCamera, texture, uniformsOf, type Uniforms } from "./program";
import { STUDIO, screenHalfSize, shadowBounds, type LoadedEnvironment, type ScreenPlace, type Shadow } from "./room";
import { MAX_SHADOWS, roomFragment, type RoomKind } from "./roomShader";
import { FULLSCREEN_VERTEX } from "./shaders";

const PANORAMA_UNIT = 3;
const SCREEN_UNIT = 4;

interface Program {
  program: WebGLProgram;
  at: Uniforms;
}

export class RoomPass {
  private readonly programs = new Map<string, Program>();
  private readonly vertexArray: WebGLVertexArrayObject;
  private readonly panorama: WebGLTexture;
  private readonly screen: WebGLTexture;
  private panoramic = false;
  private screenPlace: ScreenPlace = { centre: [0, 0, 0], azimuthRad: 0 };
  private screenHalfSize: readonly [number, number] | null = null;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.vertexArray = gl.createVertexArray();
    this.panorama = texture(gl, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    this.screen = texture(gl, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    this.setEnvironment({ panorama: null, light: null });
    this.setScreen(null);
    // ready before there is anybody to draw
    for (const shadowed of [false, true]) this.programFor({ panoramic: false, sharing: false, shadowed });
  }

  setEnvironment({ panorama }: LoadedEnvironment): void {
    this.panoramic = panorama !== null;
    this.upload(this.panorama, panorama);
  }

  /** The newest picture of a shared screen; null: none is shared. */
  setScreen(source: TexImageSource | null, width = 1, height = 1): void {
    this.screenHalfSize = source ? screenHalfSize(width, height) : null;
    this.upload(this.screen, source);
  }

  /** Where a shared screen hangs from now on. */
  placeScreen(place: ScreenPlace): void {
    this.screenPlace = place;
  }

  /** Draw `people`, a premultiplied picture as large as the camera's, and what is behind them. */
  draw(people: WebGLTexture, shadows: readonly Shadow[], { camera, framebuffer, x, y }: Eye): void {
    const { gl, panoramic } = this;
    const sharing = this.screenHalfSize !== null;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(x, y, camera.width, camera.height);
    // units 1 and 2 hold what the next eye's splats are projected from
    for (const [unit, read] of [[0, people], [PANORAMA_UNIT, this.panorama], [SCREEN_UNIT, this.screen]] as const) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, read);
    }
    gl.bindVertexArray(this.vertexArray);
    const cast = shadows.slice(0, MAX_SHADOWS);
    const eye: Eye = { camera, framebuffer, x, y };
    this.drawKind({ panoramic, sharing, shadowed: false }, [], eye);
    const bounds = shadowBounds(camera, cast);
    if (!bounds) return;
    const [left, top, right, bottom] = bounds;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(x + left, y + camera.height - bottom, right - left, bottom - top);
    this.drawKind({ panoramic, sharing, shadowed: true }, cast, eye);
    gl.disable(gl.SCISSOR_TEST);
  }

  private drawKind(kind: RoomKind, shadows: readonly Shadow[], { camera, x, y }: Eye): void {
    const { gl } = this;
    const { program: used, at } = this.programFor(kind);
    gl.useProgram(used);
    setCamera(gl, at, camera);
    gl.uniform2f(at("viewportOrigin"), x, y);
    gl.uniform3f(at("eye"), ...camera.eye);
    gl.uniform1i(at("panorama"), PANORAMA_UNIT);
    gl.uniform1i(at("screen"), SCREEN_UNIT);
    gl.uniform3f(at("screenCentre"), ...this.screenPlace.centre);
    gl.uniform2f(at("screenFacing"), Math.sin(this.screenPlace.azimuthRad), Math.cos(this.screenPlace.azimuthRad));
    gl.uniform2f(at("screenHalfSize"), ...(this.screenHalfSize ?? [1, 1]));
    gl.uniform3f(at("horizon"), ...STUDIO.horizon);
    gl.uniform3f(at("zenith"), ...STUDIO.zenith);
    gl.uniform3f(at("floorColour"), ...STUDIO.floor);
    gl.uniform1i(at("shadowCount"), shadows.length);
    if (shadows.length > 0) gl.uniform4fv(at("shadows"), shadows.flat());
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  private programFor(kind: RoomKind): Program {
    const fragment = roomFragment(kind);
    let known = this.programs.get(fragment);
    if (!known) {
      const made = program(this.gl, FULLSCREEN_VERTEX, fragment);
      known = { program: made, at: uniformsOf(this.gl, made) };
      this.programs.set(fragment, known);
    }
    return known;
  }

  private upload(into: WebGLTexture, source: TexImageSource | null): void {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, into);
    if (source) gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, source);
    else gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
  }
}
