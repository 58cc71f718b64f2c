"""A z-buffer for triangle meshes: which triangle each sample sees, and where in it."""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array


@numba.njit(cache=True, nogil=True)
def rasterise(
    pixels: Array,  # [V 2] float64, sample coordinates
    depth: Array,  # [V] float64, m along z
    faces: Array,  # [T 3] int64
    triangle: Array,  # [H W] int32, written: -1 where nothing is seen
    barycentric: Array,  # [H W 3] float32, written: perspective-correct
    nearest: Array,  # [H W] float32, written: 1 / depth
    bound: Array,  # [H W] float32, only what has a smaller 1 / depth is seen
) -> None:
    """Fill the buffers with the nearest triangle of every sample behind its bound; back faces count
    too."""
    height, width = triangle.shape
    triangle[:] = -1
    nearest[:] = 0.0
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        if depth[a] <= 1e-3 or depth[b] <= 1e-3 or depth[c] <= 1e-3:
            continue
        ax, ay, bx, by, cx, cy = (
            pixels[a, 0],
            pixels[a, 1],
            pixels[b, 0],
            pixels[b, 1],
            pixels[c, 0],
            pixels[c, 1],
        )
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        left = max(0, math.floor(min(ax, bx, cx) - 0.5))
        right = min(width - 1, math.ceil(max(ax, bx, cx) - 0.5))
        top = max(0, math.floor(min(ay, by, cy) - 0.5))
        bottom = min(height - 1, math.ceil(max(ay, by, cy) - 0.5))
        wa, wb, wc = 1.0 / depth[a], 1.0 / depth[b], 1.0 / depth[c]
        for y in range(top, bottom + 1):
            py = y + 0.5
            for x in range(left, right + 1):
                px = x + 0.5
                u = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
                v = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                # as stored, so that a triangle is never behind itself
                inverse = np.float32(u * wa + v * wb + w * wc)
                if nearest[y, x] < inverse < bound[y, x]:
                    nearest[y, x] = inverse
                    triangle[y, x] = t
                    barycentric[y, x, 0] = u * wa / inverse
                    barycentric[y, x, 1] = v * wb / inverse
                    barycentric[y, x, 2] = w * wc / inverse


@numba.njit(cache=True, nogil=True, parallel=True)
def box_filter(samples: Array, factor: int, out: Array) -> None:
    """Mean of every factor x factor block of `samples` [H*f W*f C] into `out` [H W C]."""
    for y in numba.prange(out.shape[0]):
        for x in range(out.shape[1]):
            for c in range(out.shape[2]):
                total = np.float32(0.0)
                for j in range(factor):
                    for i in range(factor):
                        total += samples[y * factor + j, x * factor + i, c]
                out[y, x, c] = total / (factor * factor)
