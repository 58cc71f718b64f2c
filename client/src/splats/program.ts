/** Programs of the graphics card, their uniforms, and textures. */

import type { PassCamera } from "./camera";

export type Uniforms = (name: string) => WebGLUniformLocation | null;

/** Asks for each uniform's place once: a browser may have to ask the card. */
export function uniformsOf(gl: WebGL2RenderingContext, of: WebGLProgram): Uniforms {
  const known = new Map<string, WebGLUniformLocation | null>();
  return (name) => {
    const place = known.get(name);
    if (place !== undefined) return place;
    const asked = gl.getUniformLocation(of, name);
    known.set(name, asked);
    return asked;
  };
}

export function program(gl: WebGL2RenderingContext, vertex: string, fragment: string): WebGLProgram {
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

/** Hand a camera to the program in use; its translation is left to whoever needs it. */
export function setCamera(gl: WebGL2RenderingContext, uniforms: Uniforms, camera: PassCamera): void {
  const m = camera.worldToCamera;
  const columns = [0, 1, 2].flatMap((c) => [m[c] ?? 0, m[4 + c] ?? 0, m[8 + c] ?? 0]);
  gl.uniformMatrix3fv(uniforms("rotation"), false, columns);
  gl.uniform2f(uniforms("focal"), ...camera.focalPx);
  gl.uniform2f(uniforms("centre"), ...camera.centrePx);
  gl.uniform2f(uniforms("size"), camera.width, camera.height);
}

export function texture(gl: WebGL2RenderingContext, filter: number = gl.NEAREST): WebGLTexture {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  for (const which of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, which, filter);
  return made;
}
