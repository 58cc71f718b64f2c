/** Eigenvectors of small symmetric matrices, by Jacobi's rotations. */

const SWEEPS = 30;
const SMALL = 1e-30;

/** Of the largest eigenvalue of a symmetric matrix, of unit length. */
export function largestEigenvector(matrix: readonly (readonly number[])[]): number[] {
  const size = matrix.length;
  const m = matrix.map((row) => [...row]);
  const vectors = m.map((_, r) => m.map((_, c) => (r === c ? 1 : 0)));
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    let left = 0;
    for (let p = 0; p < size; p++) {
      for (let q = p + 1; q < size; q++) {
        left += m[p]![q]! ** 2;
        turn(m, vectors, p, q);
      }
    }
    if (left < SMALL) break;
  }
  const values = m.map((row, i) => row[i]!);
  const largest = values.indexOf(Math.max(...values));
  return vectors.map((row) => row[largest]!);
}

/** Turn in the plane of `p` and `q` so that their product vanishes. */
function turn(m: number[][], vectors: number[][], p: number, q: number): void {
  const off = m[p]![q]!;
  if (off === 0) return;
  const theta = (m[q]![q]! - m[p]![p]!) / (2 * off);
  const tangent = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
  const cosine = 1 / Math.sqrt(tangent * tangent + 1);
  const sine = tangent * cosine;
  for (const row of [...m, ...vectors]) mix(row, p, q, cosine, sine);
  for (let k = 0; k < m.length; k++) {
    const [a, b] = [m[p]![k]!, m[q]![k]!];
    m[p]![k] = cosine * a - sine * b;
    m[q]![k] = sine * a + cosine * b;
  }
}

function mix(row: number[], p: number, q: number, cosine: number, sine: number): void {
  const [a, b] = [row[p]!, row[q]!];
  row[p] = cosine * a - sine * b;
  row[q] = sine * a + cosine * b;
}
