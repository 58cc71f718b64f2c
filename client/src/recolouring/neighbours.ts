/** Each point's nearest ones, itself among them, by a grid. */

/** Points of a cell, about. */
const IN_CELL = 4;

/** `many` indices a point, the nearest first, of x, y, z of each. */
export function nearest(points: Float32Array, many: number): Uint32Array {
  const count = points.length / 3;
  const grid = new Grid(points, count);
  const found = new Uint32Array(count * many);
  for (let i = 0; i < count; i++) grid.nearestOf(i, found.subarray(i * many, (i + 1) * many));
  return found;
}

class Grid {
  private readonly low = [Infinity, Infinity, Infinity];
  private readonly sizes = [1, 1, 1];
  private readonly cellM: number;
  private readonly cells = new Map<number, number[]>();

  constructor(
    private readonly points: Float32Array,
    count: number,
  ) {
    const high = [-Infinity, -Infinity, -Infinity];
    points.forEach((value, at) => {
      this.low[at % 3] = Math.min(this.low[at % 3]!, value);
      high[at % 3] = Math.max(high[at % 3]!, value);
    });
    const [x = 0, y = 0, z = 0] = high.map((value, axis) => Math.max(value - this.low[axis]!, 1e-3));
    // people are surfaces: as many cells are filled as fit on the sides of their box
    this.cellM = Math.sqrt((IN_CELL * (x * y + y * z + z * x)) / Math.max(count, 1));
    this.sizes = [x, y, z].map((side) => Math.floor(side / this.cellM) + 1);
    for (let i = 0; i < count; i++) {
      const key = this.keyOf(this.placeOf(i));
      const cell = this.cells.get(key);
      if (cell) cell.push(i);
      else this.cells.set(key, [i]);
    }
  }

  /** Fill `found` with the points nearest to point `i`; of too few some come twice. */
  nearestOf(i: number, found: Uint32Array): void {
    const place = this.placeOf(i);
    const near: { j: number; d2: number }[] = [];
    const farthest = Math.max(...this.sizes);
    for (let ring = 0; ring <= farthest; ring++) {
      this.visitRing(place, ring, (j) => near.push({ j, d2: this.distance2(i, j) }));
      if (near.length < found.length) continue;
      near.sort((a, b) => a.d2 - b.d2);
      // what is farther out is at least so far away
      if (near[found.length - 1]!.d2 <= (ring * this.cellM) ** 2) break;
    }
    for (let n = 0; n < found.length; n++) found[n] = near[Math.min(n, near.length - 1)]!.j;
  }

  private visitRing([x, y, z]: readonly number[], ring: number, visit: (j: number) => void): void {
    for (let a = -ring; a <= ring; a++) {
      for (let b = -ring; b <= ring; b++) {
        const inside = Math.abs(a) < ring && Math.abs(b) < ring;
        for (let c = -ring; c <= ring; c += inside && ring > 0 ? 2 * ring : 1) {
          const place = [x! + a, y! + b, z! + c];
          if (place.every((at, axis) => at >= 0 && at < this.sizes[axis]!)) this.cells.get(this.keyOf(place))?.forEach(visit);
        }
      }
    }
  }

  private distance2(i: number, j: number): number {
    const { points } = this;
    let sum = 0;
    for (let axis = 0; axis < 3; axis++) sum += (points[3 * i + axis]! - points[3 * j + axis]!) ** 2;
    return sum;
  }

  private placeOf(i: number): number[] {
    return this.low.map((low, axis) => Math.floor((this.points[3 * i + axis]! - low) / this.cellM));
  }

  private keyOf([x, y, z]: readonly number[]): number {
    return (x! * this.sizes[1]! + y!) * this.sizes[2]! + z!;
  }
}
