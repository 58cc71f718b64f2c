/**
 * Draws a cast of skinned splats over the room, in WebGL2: splats front to back into a picture of
 * their own (premultiplied, each hiding the others rightly), then that over the backdrop.
 *
 * Eight bits a channel: half floats bring 58 dB against the server's picture where these bring 52,
 * which nobody sees, cost twice the time where a processor stands in for the card, and not every
 * phone blends into them.
 */

import { SPLAT_NUMBERS, type PackedSplats } from "./packed";
import { passCamera, type Eye, type PassCamera } from "./camera";
import { Lights } from "./lights";
import { allocateOffsets, MOVED_COLUMNS } from "./moved";
import type { LaidPicture } from "./laid";
import { LaidPictures } from "./laidPictures";
import { setCamera, texture } from "./program";
import { TRANSFORM } from "./skeleton";
import { allocateOrder, ORDER_COLUMNS } from "./sort";
import { MAX_PEOPLE, TABLE_COLUMNS } from "./shaders";
import { splatPrograms, type SplatPrograms } from "./splatPrograms";
import type { LoadedEnvironment, ScreenPlace, Shadow } from "./room";
import { RoomPass } from "./roomPass";

/** Who is seen, from wherever. */
export interface PassPeople {
  /** A transform a joint of the cast, one person after the other. */
  transforms: Float32Array;
  /** Of the cast's moved splats, see `moveSplats`; another array where anything changed. */
  offsets: Float32Array;
  /** Splats by rising depth, of which the first `count` are drawn. */
  order: Uint32Array;
  count: number;
  /** Factor of each person's variances: more than 1 where not all of their splats are drawn. */
  growth: readonly number[];
  /** About +y, by which each person was turned, and the light of their clip with them. */
  yawsRad: readonly number[];
  shadows: readonly Shadow[];
  hideUnseen: boolean;
}

/** What changes from picture to picture. */
export interface PassFrame extends PassPeople {
  camera: PassCamera;
}

/** An empty room. */
export const NOBODY: PassPeople = {
  transforms: new Float32Array(TRANSFORM),
  offsets: allocateOffsets(0),
  order: allocateOrder(0),
  count: 0,
  growth: [],
  yawsRad: [],
  shadows: [],
  hideUnseen: false,
};
const WARM_UP_PX = 16;

export class SplatPass {
  readonly gl: WebGL2RenderingContext;
  private readonly programs: SplatPrograms;
  /** Made for the first picture that is laid on somebody: few meetings have one. */
  private layingPrograms: SplatPrograms | null = null;
  private readonly emptyVertexArray: WebGLVertexArrayObject;
  private readonly order: WebGLTexture;
  private readonly table: WebGLTexture;
  private readonly transforms: WebGLTexture;
  private readonly offsets: WebGLTexture;
  private readonly changes: WebGLTexture;
  /** What `PROJECT_FRAGMENT` writes, a texel a splat in the order of drawing. */
  private readonly ellipses: WebGLTexture;
  private readonly appearances: WebGLTexture;
  private readonly projectedFramebuffer: WebGLFramebuffer;
  private readonly picture: WebGLTexture;
  private readonly target: WebGLFramebuffer;
  private readonly room: RoomPass;
  private readonly lights = new Lights();
  private readonly laid: LaidPictures;
  private uploadedOrder: Uint32Array | null = null;
  private uploadedOffsets: Float32Array | null = null;
  private size = { width: 0, height: 0 };

  /** Throws where the browser has no WebGL2. `xrCompatible`: a headset is to show what is drawn. */
  constructor(canvas: HTMLCanvasElement | OffscreenCanvas, xrCompatible = false) {
    const attributes = { alpha: false, antialias: false, depth: false, xrCompatible };
    const gl = (canvas as HTMLCanvasElement).getContext("webgl2", attributes) as WebGL2RenderingContext | null;
    if (!gl) throw new Error("drawing takes WebGL2; this browser has none");
    this.gl = gl;
    this.programs = splatPrograms(gl, false);
    this.laid = new LaidPictures(gl);
    this.table = texture(gl);
    this.transforms = texture(gl);
    this.offsets = texture(gl);
    this.changes = texture(gl);
    this.ellipses = texture(gl);
    this.appearances = texture(gl);
    this.projectedFramebuffer = gl.createFramebuffer();
    this.picture = texture(gl);
    this.room = new RoomPass(gl);
    this.target = gl.createFramebuffer();
    this.order = texture(gl);
    this.emptyVertexArray = gl.createVertexArray();
    this.warmUp();
  }

  /** Draw nothing: the shaders are made ready by a card's first commands, while files are on their way. */
  private warmUp(): void {
    const looking = { position: [0, 1, 0], wxyz: [1, 0, 0, 0] } as const;
    this.clear();
    this.draw({
      camera: passCamera(looking, 1, WARM_UP_PX, WARM_UP_PX),
      transforms: new Float32Array(TRANSFORM),
      offsets: allocateOffsets(1),
      order: allocateOrder(1),
      count: 1,
      growth: [1],
      yawsRad: [0],
      shadows: [[0, 0, 1, 1]],
      hideUnseen: false,
    });
    this.gl.flush();
  }

  /** Hand over the splats; they stay on the card. */
  setSplats(cast: Pick<PackedSplats, "count" | "table" | "people">): void {
    const { gl } = this;
    const rows = Math.max(1, Math.ceil(cast.count / TABLE_COLUMNS));
    const padded = new Uint32Array(rows * TABLE_COLUMNS * SPLAT_NUMBERS);
    padded.set(cast.table);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.texImage2D(
      gl.TEXTURE_2D, 0, gl.RGBA32UI, 4 * TABLE_COLUMNS, rows, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, padded,
    );
    this.laid.setPeople(cast.people);
    this.setChanges(new Uint32Array(cast.count));
    this.allocateProjected(cast.count);
    this.uploadedOrder = null;
    this.lights.setClipLights(cast.people.map(({ light }) => light));
  }

  /**
   * What live look changes of each splat's colours from now on, see `packChanges`; nil: nothing. `laid`: the picture
   * that is laid on each person; null: none.
   */
  setChanges(changes: Uint32Array, laid: readonly (LaidPicture | null)[] = []): void {
    const { gl } = this;
    this.laid.set(laid);
    const rows = Math.max(1, Math.ceil(changes.length / TABLE_COLUMNS));
    const padded = new Uint32Array(rows * TABLE_COLUMNS);
    padded.set(changes);
    gl.activeTexture(gl.TEXTURE4);
    gl.bindTexture(gl.TEXTURE_2D, this.changes);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R32UI, TABLE_COLUMNS, rows, 0, gl.RED_INTEGER, gl.UNSIGNED_INT, padded);
  }

  /** Keep nobody's splats on the card. */
  clear(): void {
    this.setSplats({ count: 1, table: new Uint32Array(SPLAT_NUMBERS), people: [] });
  }

  /** Where everybody is from now on. */
  setEnvironment(place: LoadedEnvironment): void {
    this.lights.setRoom(place.light);
    this.room.setEnvironment(place);
  }

  /** The newest picture of a shared screen; null: none is shared. */
  setScreen(source: TexImageSource | null, width = 1, height = 1): void {
    this.room.setScreen(source, width, height);
  }

  /** Where a shared screen hangs from now on. */
  placeScreen(place: ScreenPlace): void {
    this.room.placeScreen(place);
  }

  /** Draw into the canvas, which takes the size of the camera's picture. */
  draw(frame: PassFrame): void {
    const { camera } = frame;
    const { canvas } = this.gl;
    if (canvas.width !== camera.width) canvas.width = camera.width;
    if (canvas.height !== camera.height) canvas.height = camera.height;
    this.drawEyes(frame, [{ camera, framebuffer: null, x: 0, y: 0 }]);
  }

  /** Draw the same people into each of `eyes`; the framebuffer of the last one stays bound. */
  drawEyes(people: PassPeople, eyes: readonly Eye[]): void {
    this.upload(people);
    for (const eye of eyes) {
      this.drawPeople(people, eye.camera);
      this.room.draw(this.picture, people.shadows, eye);
    }
  }

  /** Draw people alone, and read them: premultiplied RGBA bytes, the top row first. */
  readPeople(people: PassPeople, camera: PassCamera): Uint8Array {
    this.upload(people);
    this.drawPeople(people, camera);
    return this.read();
  }

  /** What was drawn last, RGBA bytes, the top row first; also waits until everything is drawn. */
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

  /** Draw people into their picture, whose framebuffer stays bound. */
  private drawPeople(people: PassPeople, camera: PassCamera): void {
    this.resize(camera);
    const laid = this.laid.seenBy(camera, people.transforms);
    this.projectSplats(people, camera, laid);
    this.drawSplats(people, camera, laid);
  }

  private upload({ transforms, offsets, order }: PassPeople): void {
    const { gl } = this;
    this.uploadOffsets(offsets);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.transforms);
    gl.texImage2D(
      gl.TEXTURE_2D, 0, gl.RGBA32F, 3, transforms.length / 12, 0, gl.RGBA, gl.FLOAT, transforms,
    );
    gl.activeTexture(gl.TEXTURE2);
    gl.bindTexture(gl.TEXTURE_2D, this.order);
    if (this.uploadedOrder === order) return;
    const rows = order.length / ORDER_COLUMNS;
    gl.texImage2D(
      gl.TEXTURE_2D, 0, gl.R32UI, ORDER_COLUMNS, rows, 0, gl.RED_INTEGER, gl.UNSIGNED_INT, order,
    );
    this.uploadedOrder = order;
  }

  private uploadOffsets(offsets: Float32Array): void {
    const { gl } = this;
    if (this.uploadedOffsets === offsets) return;
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, this.offsets);
    const rows = offsets.length / (4 * MOVED_COLUMNS);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, MOVED_COLUMNS, rows, 0, gl.RGBA, gl.FLOAT, offsets);
    this.uploadedOffsets = offsets;
  }

  private allocateProjected(count: number): void {
    const { gl } = this;
    const rows = Math.max(1, Math.ceil(count / ORDER_COLUMNS));
    const points = [gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.projectedFramebuffer);
    [this.ellipses, this.appearances].forEach((into, nth) => {
      gl.bindTexture(gl.TEXTURE_2D, into);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, ORDER_COLUMNS, rows, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, null);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, points[nth] ?? 0, gl.TEXTURE_2D, into, 0);
    });
    gl.drawBuffers(points);
  }

  private programsFor(laid: boolean): SplatPrograms {
    if (!laid) return this.programs;
    this.layingPrograms ??= splatPrograms(this.gl, true);
    return this.layingPrograms;
  }

  /** Work out where in the picture each splat is drawn. */
  private projectSplats({ count, growth, yawsRad, hideUnseen }: PassPeople, camera: PassCamera, laid: boolean): void {
    const { gl } = this;
    if (count === 0) return;
    const { project, projectUniforms: at } = this.programsFor(laid);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.projectedFramebuffer);
    gl.viewport(0, 0, ORDER_COLUMNS, Math.ceil(count / ORDER_COLUMNS));
    gl.useProgram(project);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, this.offsets);
    gl.activeTexture(gl.TEXTURE4);
    gl.bindTexture(gl.TEXTURE_2D, this.changes);
    gl.uniform1i(at("changes"), 4);
    gl.uniform1i(at("transforms"), 1);
    gl.uniform1i(at("order"), 2);
    gl.uniform1i(at("offsets"), 3);
    gl.uniform1i(at("hideUnseen"), hideUnseen ? 1 : 0);
    if (growth.length > 0) gl.uniform1fv(at("growth"), growth.slice(0, MAX_PEOPLE));
    setCamera(gl, at, camera);
    const t = camera.worldToCamera;
    gl.uniform3f(at("translation"), t[3] ?? 0, t[7] ?? 0, t[11] ?? 0);
    this.lights.set(gl, at, camera.eye, yawsRad);
    if (laid) this.laid.usePlaces(at);
    gl.bindVertexArray(this.emptyVertexArray);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  private drawSplats({ count }: PassPeople, { width, height }: PassCamera, laid: boolean): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (count === 0) return;
    const { splat, splatUniforms: at } = this.programsFor(laid);
    gl.useProgram(splat);
    if (laid) this.laid.useDetail(at);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.ellipses);
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, this.appearances);
    gl.uniform1i(at("appearances"), 3);
    gl.uniform2f(at("size"), width, height);
    gl.bindVertexArray(this.emptyVertexArray);
    gl.enable(gl.BLEND);
    // front to back: each splat gets what the ones before it let through
    gl.blendFunc(gl.ONE_MINUS_DST_ALPHA, gl.ONE);
    gl.drawArrays(gl.TRIANGLES, 0, 3 * count);
    gl.disable(gl.BLEND);
  }

  private resize({ width, height }: PassCamera): void {
    const { gl, size } = this;
    if (size.width === width && size.height === height) return;
    this.size = { width, height };
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.picture, 0);
  }
}
