/** What light falls on whom: the room's on everybody, else on each that of the clip they come from. */

import type { Light } from "../api/types";
import type { Uniforms } from "./program";
import { MAX_PEOPLE } from "./shaders";

/** Of one light: nine harmonics of three colours. */
const NUMBERS = 27;
const NONE = [0, 0, 0] as const;

export class Lights {
  private room: Light | null = null;
  private filmed: readonly (Float32Array | null)[] = [];
  /** Of each person, as the shader takes it: whether any falls on them, which, and whence. */
  private readonly lit = new Int32Array(MAX_PEOPLE);
  private readonly harmonics = new Float32Array(NUMBERS * MAX_PEOPLE);
  private readonly clipYaws = new Float32Array(2 * MAX_PEOPLE);

  /** The light of each person's clip; null where it is not known. */
  setClipLights(filmed: readonly (Float32Array | null)[]): void {
    this.filmed = filmed.slice(0, MAX_PEOPLE);
    this.choose();
  }

  /** The light of the room from now on; null: it has none of its own. */
  setRoom(light: Light | null): void {
    this.room = light;
    this.choose();
  }

  /** Hand them to the program in use; each clip's was turned with its person, by a yaw (rad). */
  set(gl: WebGL2RenderingContext, at: Uniforms, eye: readonly [number, number, number], yawsRad: readonly number[]): void {
    for (let person = 0; person < MAX_PEOPLE; person++) {
      const yawRad = this.room ? 0 : (yawsRad[person] ?? 0);
      this.clipYaws[2 * person] = Math.cos(yawRad);
      this.clipYaws[2 * person + 1] = Math.sin(yawRad);
    }
    gl.uniform1iv(at("lit"), this.lit);
    gl.uniform3fv(at("harmonics"), this.harmonics);
    gl.uniform2fv(at("clipYaw"), this.clipYaws);
    gl.uniform3f(at("eye"), ...eye);
    gl.uniform3f(at("keyDirection"), ...(this.room?.key_direction ?? NONE));
    gl.uniform3f(at("keyColour"), ...(this.room?.key_colour ?? NONE));
  }

  private choose(): void {
    const room = this.room?.harmonics.flat();
    this.filmed.forEach((own, person) => {
      const light = room ?? own;
      this.lit[person] = light ? 1 : 0;
      if (light) this.harmonics.set(light, NUMBERS * person);
    });
  }
}
