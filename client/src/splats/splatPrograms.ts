/** The programs that place splats in the picture and draw them. */

import { program, uniformsOf, type Uniforms } from "./program";
import { FULLSCREEN_VERTEX, laying, PROJECT_FRAGMENT, SPLAT_FRAGMENT, SPLAT_VERTEX } from "./shaders";

export interface SplatPrograms {
  project: WebGLProgram;
  projectUniforms: Uniforms;
  splat: WebGLProgram;
  splatUniforms: Uniforms;
}

/** `laid`: for views in which somebody's picture is laid on them; views without one are drawn as fast as ever. */
export function splatPrograms(gl: WebGL2RenderingContext, laid: boolean): SplatPrograms {
  const of = laid ? laying : (source: string): string => source;
  const project = program(gl, FULLSCREEN_VERTEX, of(PROJECT_FRAGMENT));
  const splat = program(gl, of(SPLAT_VERTEX), of(SPLAT_FRAGMENT));
  return { project, projectUniforms: uniformsOf(gl, project), splat, splatUniforms: uniformsOf(gl, splat) };
}
