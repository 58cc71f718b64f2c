/**
 * Into `to`, what `choose` (least or most) takes of each pixel of `values` and the eight round it; beyond the edge there
 * are none. Both may be the same; `row` is overwritten.
 */
export function chosenAround(
  values: Float32Array,
  side: number,
  choose: (a: number, b: number) => number,
  to: Float32Array,
  row: Float32Array,
): void {
  for (let y = 0; y < side; y++) {
    const here = side * y;
    const above = side * Math.max(0, y - 1);
    const below = side * Math.min(side - 1, y + 1);
    for (let x = 0; x < side; x++) row[here + x] = choose(choose(values[above + x]!, values[here + x]!), values[below + x]!);
  }
  for (let y = 0; y < side; y++) {
    const here = side * y;
    for (let x = 0; x < side; x++) {
      const left = Math.max(0, x - 1);
      const right = Math.min(side - 1, x + 1);
      to[here + x] = choose(choose(row[here + left]!, row[here + x]!), row[here + right]!);
    }
  }
}
