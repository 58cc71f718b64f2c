"""Sums over pixels of what a pose's normal equations are made of.

A pixel's Jacobian is X (w_1 B_1 + w_2 B_2 + ...): X [2 7] is the pixel's own (how it moves by a
rotation of its point about the world's origin, by a shift, and by the focal length), w_k are the
blend weights of its point, and the bases B_k of the joints are those of all pixels. So sums of
w_k w_l X^T T X, 7 x 7 numbers for each pair of joints that carry a point together, are all that
pixels have to give.
"""

from __future__ import annotations

import numba
import numpy as np

from scene.arrays import Array

OWN = 7
"""Columns of X: a rotation about the world's axes, a shift along them, and the focal length's
logarithm."""
_LEAST_DEPTH_M = 0.05


@numba.njit(inline="always", fastmath=True)
def _pixel_motion(point, camera, x):
    """Fill X of a `point` in the world."""
    px = camera[0, 0] * point[0] + camera[0, 1] * point[1] + camera[0, 2] * point[2] + camera[0, 3]
    py = camera[1, 0] * point[0] + camera[1, 1] * point[1] + camera[1, 2] * point[2] + camera[1, 3]
    pz = camera[2, 0] * point[0] + camera[2, 1] * point[1] + camera[2, 2] * point[2] + camera[2, 3]
    inverse = 1.0 / max(pz, _LEAST_DEPTH_M)
    fx, fy = camera[3, 0] * inverse, camera[3, 1] * inverse
    for c in range(3):
        x[0, 3 + c] = fx * (camera[0, c] - px * inverse * camera[2, c])
        x[1, 3 + c] = fy * (camera[1, c] - py * inverse * camera[2, c])
    x[0, 6], x[1, 6] = fx * px, fy * py
    for r in range(2):
        a, b, c = x[r, 3], x[r, 4], x[r, 5]
        x[r, 0] = point[1] * c - point[2] * b
        x[r, 1] = point[2] * a - point[0] * c
        x[r, 2] = point[0] * b - point[1] * a


@numba.njit(inline="always", fastmath=True)
def _skin(rest, joints, weights, transforms, point):
    """Fill `point`: where it is in the world."""
    point[:] = 0.0
    for k in range(joints.shape[0]):
        for r in range(3):
            value = transforms[joints[k], r, 3]
            for c in range(3):
                value += transforms[joints[k], r, c] * rest[c]
            point[r] += weights[k] * value


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def sum_pixels(
    tensors: Array,  # [P 2 2] float64, symmetric: T
    gradients: Array,  # [P 2] float64
    rest: Array,  # [P 3] float32: of the point that each pixel shows
    joints: Array,  # [P 4] uint8
    weights: Array,  # [P 4] float32
    transforms: Array,  # [K 4 4] float64, from rest to the world
    camera: Array,  # [4 4] float32: rows R|t, then fx fy cx cy
    matrices: Array,  # [threads K K 49] float64, must be nil: w_k w_l X^T T X, k <= l
    vectors: Array,  # [threads K 7] float64, must be nil: w_k X^T gradient
) -> None:
    """Add up all pixels; a pair of joints is added to its upper block alone."""
    threads = matrices.shape[0]
    for thread in numba.prange(threads):
        x, tx = np.empty((2, OWN)), np.empty((2, OWN))
        own, pull, point = np.empty(OWN * OWN), np.empty(OWN), np.empty(3)
        for p in range(thread, rest.shape[0], threads):
            _skin(rest[p], joints[p], weights[p], transforms, point)
            _pixel_motion(point, camera, x)
            for c in range(OWN):
                tx[0, c] = tensors[p, 0, 0] * x[0, c] + tensors[p, 0, 1] * x[1, c]
                tx[1, c] = tensors[p, 1, 0] * x[0, c] + tensors[p, 1, 1] * x[1, c]
                pull[c] = gradients[p, 0] * x[0, c] + gradients[p, 1] * x[1, c]
            for r in range(OWN):
                for c in range(OWN):
                    own[r * OWN + c] = x[0, r] * tx[0, c] + x[1, r] * tx[1, c]
            for a in range(joints.shape[1]):
                weight, joint = weights[p, a], joints[p, a]
                if weight == 0.0:
                    continue
                for c in range(OWN):
                    vectors[thread, joint, c] += weight * pull[c]
                for b in range(joints.shape[1]):
                    # by symmetry, what the lower block would get is the upper one's
                    if joints[p, b] < joint or weights[p, b] == 0.0:
                        continue
                    both, total = weight * weights[p, b], matrices[thread, joint, joints[p, b]]
                    for i in range(OWN * OWN):
                        total[i] += both * own[i]


@numba.njit(fastmath=True, nogil=True, cache=True)
def by_numbers(
    matrices: Array,  # [threads K K 49] float64, as `sum_pixels` fills them
    vectors: Array,  # [threads K 7] float64
    bases: Array,  # [K 7 D] float64
    matrix: Array,  # [D D] float64, must be nil: the sum over joints of B_k^T M_kl B_l
    vector: Array,  # [D] float64, must be nil
) -> None:
    """From pairs of joints to the pose's numbers.

    Most blocks and most of each basis are nil; and a threaded matrix product of BLAS leaves its
    threads spinning, which doubles the time of the kernels that follow.
    """
    joints, numbers = bases.shape[0], bases.shape[2]
    total, half = np.empty(OWN * OWN), np.empty((OWN, numbers))
    used, counts = np.empty((joints, numbers), np.int64), np.zeros(joints, np.int64)
    for k in range(joints):
        for d in range(numbers):
            if np.any(bases[k, :, d] != 0.0):
                used[k, counts[k]] = d
                counts[k] += 1
        for thread in range(vectors.shape[0]):
            for r in range(OWN):
                for d in range(numbers):
                    vector[d] += vectors[thread, k, r] * bases[k, r, d]
    for k in range(joints):
        for other in range(k, joints):
            total[:] = 0.0
            for thread in range(matrices.shape[0]):
                total += matrices[thread, k, other]
            if not np.any(total != 0.0):
                continue
            for r in range(OWN):
                for n in range(counts[other]):
                    d, value = used[other, n], 0.0
                    for c in range(OWN):
                        value += total[r * OWN + c] * bases[other, c, d]
                    half[r, d] = value
            for m in range(counts[k]):
                row = used[k, m]
                for n in range(counts[other]):
                    d, value = used[other, n], 0.0
                    for r in range(OWN):
                        value += bases[k, r, row] * half[r, d]
                    matrix[row, d] += value
                    if other != k:
                        matrix[d, row] += value
