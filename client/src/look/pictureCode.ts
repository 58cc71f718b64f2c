/**
 * The code in a picture that is sent for live look: when it was captured, and which square of the webcam's
 * picture it shows. services/live/look/picture_code.py tells the layout and reads it; tests hold both to the
 * same bits.
 */

export const CELL_PX = 16;
/** A side of the code, in cells. */
export const CELLS = 9;
const MODULO = 65536;
const OFFSET = 2048;
const CHECK_BITS = 8;
const POLYNOMIAL = 0x07;

/** A square of a picture, px; it may reach beyond. */
export interface Square {
  x: number;
  y: number;
  side: number;
}

/** The 81 cells, row by row; true is white. */
export function pictureCodeCells(capturedMs: number, { x, y, side }: Square): boolean[] {
  const told = [
    ...bits(Math.floor(capturedMs) % MODULO, 16),
    ...bits(x + OFFSET, 12),
    ...bits(y + OFFSET, 12),
    ...bits(side, 12),
  ];
  const cells = [...told, ...bits(check(told), CHECK_BITS)];
  return [...cells, ...Array<boolean>(CELLS * CELLS - cells.length).fill(false)];
}

function bits(value: number, count: number): boolean[] {
  return Array.from({ length: count }, (_, index) => ((value >> (count - 1 - index)) & 1) === 1);
}

/** CRC-8 of x^8 + x^2 + x + 1, started at 255: black cells are no code. */
function check(told: readonly boolean[]): number {
  return told.reduce((rest, bit) => {
    const carry = rest >> 7 !== Number(bit);
    return ((rest << 1) & 0xff) ^ (carry ? POLYNOMIAL : 0);
  }, 0xff);
}
