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
  /** Squared distances of those found, m^2. */
  private far = new Float64Array(0);

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
      const [a = 0, b = 0, c = 0] = this.placeOf(i);
      const key = (a * this.sizes[1]! + b) * this.sizes[2]! + c;
      const cell = this.cells.get(key);
      if (cell) cell.push(i);
      else this.cells.set(key, [i]);
    }
  }

  /** Fill `found` with as many points, of which there are enough, nearest to point `i`. */
  nearestOf(i: number, found: Uint32Array): void {
    const [x = 0, y = 0, z = 0] = this.placeOf(i);
    const farthest = Math.max(...this.sizes);
    this.far = new Float64Array(found.length).fill(Infinity);
    for (let ring = 0; ring <= farthest; ring++) {
      this.lookAtRing(i, x, y, z, ring, found);
      // what is farther out is at least so far away
      if (this.far[found.length - 1]! <= (ring * this.cellM) ** 2) break;
    }
  }

  private lookAtRing(i: number, x: number, y: number, z: number, ring: number, found: Uint32Array): void {
    const [wide = 0, high = 0, deep = 0] = this.sizes;
    for (let a = Math.max(0, x - ring); a <= Math.min(wide - 1, x + ring); a++) {
      for (let b = Math.max(0, y - ring); b <= Math.min(high - 1, y + ring); b++) {
        const inside = Math.abs(a - x) < ring && Math.abs(b - y) < ring;
        for (let c = z - ring; c <= z + ring; c += inside && ring > 0 ? 2 * ring : 1) {
          const cell = c < 0 || c >= deep ? undefined : this.cells.get((a * high + b) * deep + c);
          for (const j of cell ?? []) this.consider(j, this.distance2(i, j), found);
        }
      }
    }
  }

  /** Put point `j` among the nearest, if it is. */
  private consider(j: number, d2: number, found: Uint32Array): void {
    const { far } = this;
    let at = found.length;
    for (; at > 0 && d2 < far[at - 1]!; at--) {
      if (at === found.length) continue;
      far[at] = far[at - 1]!;
      found[at] = found[at - 1]!;
    }
    if (at === found.length) return;
    far[at] = d2;
    found[at] = j;
  }

  private distance2(i: number, j: number): number {
    const { points } = this;
    const x = points[3 * i]! - points[3 * j]!;
    const y = points[3 * i + 1]! - points[3 * j + 1]!;
    const z = points[3 * i + 2]! - points[3 * j + 2]!;
    return x * x + y * y + z * z;
  }

  private placeOf(i: number): number[] {
    return this.low.map((low, axis) => Math.floor((this.points[3 * i + axis]! - low) / this.cellM));
  }
}
