/** The pictures that are laid on people, on the graphics card. */

import { PICTURE_PX } from "../look/cutOut";
import type { PassCamera } from "./camera";
import { layingOf, type LaidPicture } from "./laid";
import type { PackedSplats } from "./packed";
import { texture, type Uniforms } from "./program";
import { MAX_PEOPLE, TABLE_COLUMNS } from "./shaders";
import { TRANSFORM } from "./skeleton";

/** Pictures that are laid on at once, those of the first people of the cast. */
const MOST_LAID = 8;
const PLACES_UNIT = 5;
const DETAIL_UNIT = 6;
/** Numbers a person that the shader takes: strength, scale and layer. */
const NUMBERS = 3;

export class LaidPictures {
  private people: PackedSplats["people"] = [];
  /** Of each person; null: none is laid on them. */
  private pictures: readonly (LaidPicture | null)[] = [];
  /** Whose pictures are laid, each in the layer of the same number. */
  private layers: readonly number[] = [];
  private readonly uploaded: (LaidPicture | null)[] = [];
  private textures: { places: WebGLTexture; detail: WebGLTexture } | null = null;
  private readonly numbers = new Float32Array(NUMBERS * MAX_PEOPLE);

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /** Other people are drawn: nothing is laid on them yet. */
  setPeople(people: PackedSplats["people"]): void {
    this.people = people;
    this.set([]);
  }

  /** The picture of each person from now on. */
  set(pictures: readonly (LaidPicture | null)[]): void {
    this.pictures = pictures;
    this.layers = pictures.flatMap((one, person) => (one && person < MAX_PEOPLE ? [person] : [])).slice(0, MOST_LAID);
    if (this.layers.length === 0) return this.release();
    this.textures ??= this.makeTextures();
    this.uploadPlaces(this.textures.places);
    this.uploadDetail(this.textures.detail);
  }

  /** Whether any is laid on in this view of people whose joints are at `transforms`; to be asked before `usePlaces`. */
  seenBy(camera: PassCamera, transforms: Float32Array): boolean {
    const { layers, numbers, people, pictures } = this;
    if (layers.length === 0) return false;
    numbers.fill(0);
    let [at, seen] = [0, false];
    people.forEach(({ parents, restJoints }, person) => {
      const picture = pictures[person];
      const layer = layers.indexOf(person);
      if (picture && layer >= 0) {
        const { strength, scale } = layingOf(picture, restJoints, transforms, at, camera);
        numbers.set([strength, scale, layer], NUMBERS * person);
        seen ||= strength > 0;
      }
      at += TRANSFORM * parents.length;
    });
    return seen;
  }

  /** Hand the places to the program in use, which projects. */
  usePlaces(at: Uniforms): void {
    const { gl, textures, numbers } = this;
    gl.activeTexture(gl.TEXTURE0 + PLACES_UNIT);
    gl.bindTexture(gl.TEXTURE_2D, textures?.places ?? null);
    gl.uniform1i(at("places"), PLACES_UNIT);
    gl.uniform3fv(at("laid"), numbers);
  }

  /** Hand the details to the program in use, which draws splats. */
  useDetail(at: Uniforms): void {
    const { gl, textures } = this;
    gl.activeTexture(gl.TEXTURE0 + DETAIL_UNIT);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, textures?.detail ?? null);
    gl.uniform1i(at("detail"), DETAIL_UNIT);
  }

  /** Keep nobody's picture. */
  private release(): void {
    const { gl, textures } = this;
    this.uploaded.length = 0;
    if (!textures) return;
    for (const one of [textures.places, textures.detail]) gl.deleteTexture(one);
    this.textures = null;
  }

  private makeTextures() {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + PLACES_UNIT);
    const places = texture(gl);
    const detail = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + DETAIL_UNIT);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, detail);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGB10_A2, PICTURE_PX, PICTURE_PX, MOST_LAID);
    for (const which of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, which, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, side, gl.CLAMP_TO_EDGE);
    return { places, detail };
  }

  private uploadPlaces(into: WebGLTexture): void {
    const { gl, layers, people, pictures } = this;
    const count = people.reduce((sum, person) => sum + person.count, 0);
    const rows = Math.max(1, Math.ceil(count / TABLE_COLUMNS));
    const all = new Uint32Array(rows * TABLE_COLUMNS);
    let first = 0;
    people.forEach((one, person) => {
      const picture = pictures[person];
      if (picture && layers.includes(person)) all.set(picture.places, first);
      first += one.count;
    });
    gl.activeTexture(gl.TEXTURE0 + PLACES_UNIT);
    gl.bindTexture(gl.TEXTURE_2D, into);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R32UI, TABLE_COLUMNS, rows, 0, gl.RED_INTEGER, gl.UNSIGNED_INT, all);
  }

  private uploadDetail(into: WebGLTexture): void {
    const { gl, pictures, uploaded } = this;
    gl.activeTexture(gl.TEXTURE0 + DETAIL_UNIT);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, into);
    uploaded.length = this.layers.length;
    this.layers.forEach((person, layer) => {
      const picture = pictures[person];
      if (!picture || uploaded[layer] === picture) return;
      uploaded[layer] = picture;
      const [format, kind] = [gl.RGBA, gl.UNSIGNED_INT_2_10_10_10_REV];
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, PICTURE_PX, PICTURE_PX, 1, format, kind, picture.detail);
    });
  }
}
