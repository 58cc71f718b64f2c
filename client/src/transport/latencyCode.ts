/**
 * When the newest pose was captured, as a bar code in a picture's corner: how latency is measured.
 *
 * The server writes it into its pictures where its setting `stamp_pictures` is on (services/live/streaming/latency_code.py
 * tells the layout), and tells poses the same time; a page opened with `?stamp` writes it into what it draws
 * itself, and reads back from the pixels whatever it shows. On one machine, whose clock both ends share, the
 * difference is the whole way from a webcam's landmarks to the picture.
 */

export const CELL_PX = 16;
export const COLUMNS = 10;
const ROWS = 2;
const WIDTH = COLUMNS * CELL_PX;
const HEIGHT = ROWS * CELL_PX;
const MODULO = 65536;
const KEPT = 900;

/** The 20 cells of a capture time (ms), row by row; true is white. */
export function latencyCodeCells(capturedMs: number): boolean[] {
  const value = Math.floor(capturedMs) % MODULO;
  const nibbles = [0, 4, 8, 12].reduce((sum, shift) => sum + ((value >>> shift) & 15), 0);
  const check = (nibbles + 5) & 15;
  const bit = (of: number, highest: number) => (_: unknown, index: number) =>
    ((of >>> (highest - index)) & 1) === 1;
  return [...Array.from({ length: 16 }, bit(value, 15)), ...Array.from({ length: 4 }, bit(check, 3))];
}

/** Write the code into the upper left corner of what `gl` has drawn, `height` px high. */
export function drawLatencyCode(gl: WebGL2RenderingContext, height: number, capturedMs: number): void {
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.enable(gl.SCISSOR_TEST);
  latencyCodeCells(capturedMs).forEach((white, index) => {
    const [row, column] = [Math.floor(index / COLUMNS), index % COLUMNS];
    const shade = white ? 1 : 0;
    gl.scissor(column * CELL_PX, height - (row + 1) * CELL_PX, CELL_PX, CELL_PX);
    gl.clearColor(shade, shade, shade, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  });
  gl.clearColor(0, 0, 0, 0);
  gl.disable(gl.SCISSOR_TEST);
}

/** The capture time (ms, modulo 65,536) in the RGBA of a picture's corner; null where there is no code. */
export function readLatencyCode(rgba: Uint8ClampedArray): number | null {
  const cells = Array.from({ length: COLUMNS * ROWS }, (_, index) => {
    const [row, column] = [Math.floor(index / COLUMNS), index % COLUMNS];
    let sum = 0;
    for (let y = 4; y < 12; y++) {
      for (let x = 4; x < 12; x++) {
        sum += rgba[4 * ((row * CELL_PX + y) * WIDTH + column * CELL_PX + x) + 1] ?? 0;
      }
    }
    return sum > 64 * 128;
  });
  const value = cells.slice(0, 16).reduce((bits, cell) => 2 * bits + (cell ? 1 : 0), 0);
  return latencyCodeCells(value).every((cell, index) => cell === cells[index]) ? value : null;
}

/** Milliseconds from `captured` (modulo 65,536) to `nowMs`. */
export function sinceCapture(captured: number, nowMs: number): number {
  return (((nowMs - captured) % MODULO) + MODULO) % MODULO;
}

/** Reads the code of each new picture, and adds how old it is, ms, to `out.dataset.latencies`. */
export class LatencyMeter {
  private readonly context = new OffscreenCanvas(WIDTH, HEIGHT).getContext("2d", {
    willReadFrequently: true,
  });
  private last: number | null = null;

  constructor(private readonly out: HTMLElement) {}

  /** Look at the picture that `source` shows now; one that was looked at before counts no more. */
  look(source: HTMLVideoElement | HTMLCanvasElement): void {
    if (!this.context) return;
    this.context.drawImage(source, 0, 0, WIDTH, HEIGHT, 0, 0, WIDTH, HEIGHT);
    const captured = readLatencyCode(this.context.getImageData(0, 0, WIDTH, HEIGHT).data);
    if (captured === null || captured === this.last) return;
    this.last = captured;
    const age = Math.round(sinceCapture(captured, performance.timeOrigin + performance.now()));
    const before = this.out.dataset["latencies"]?.split(",") ?? [];
    this.out.dataset["latencies"] = [...before, age].slice(-KEPT).join();
  }
}
