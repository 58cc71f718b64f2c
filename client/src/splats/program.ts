/** Programs of the graphics card, and their uniforms. */

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
