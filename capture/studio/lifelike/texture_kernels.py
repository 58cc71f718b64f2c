"""Sampling of textures at what a z-buffer has found."""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array


@numba.njit(cache=True, nogil=True)
def sample_textures(
    triangle: Array,  # [H W] int32, -1 where nothing is seen
    barycentric: Array,  # [H W 3] float32
    nearest: Array,  # [H W] float32, 1 / depth
    texture: Array,  # [T 3 2] float64, right and up
    picture: Array,  # [T] int64, of which picture each triangle is
    uv_per_m: Array,  # [T] float64, how far texture coordinates go in a metre
    focal: float,  # samples
    texels: Array,  # [X 4] uint8
    places: Array,  # [P L 3] int64
    out: Array,  # [H W 4] float32, written: premultiplied, 0 where nothing is seen
) -> None:
    """Bilinear samples of the level whose texels are about as large as a sample."""
    levels = places.shape[1]
    for y in range(triangle.shape[0]):
        for x in range(triangle.shape[1]):
            t = triangle[y, x]
            if t < 0:
                for c in range(4):
                    out[y, x, c] = 0.0
                continue
            u, v = 0.0, 0.0
            for k in range(3):
                u += barycentric[y, x, k] * texture[t, k, 0]
                v += barycentric[y, x, k] * texture[t, k, 1]
            p = picture[t]
            sample_m = 1.0 / (nearest[y, x] * focal)
            texels_across = max(uv_per_m[t] * sample_m * places[p, 0, 2], 1.0)
            level = min(levels - 1, int(math.log2(texels_across) + 0.5))
            first, height, width = places[p, level, 0], places[p, level, 1], places[p, level, 2]
            column = min(max(u * width - 0.5, 0.0), width - 1.0)
            row = min(max((1.0 - v) * height - 0.5, 0.0), height - 1.0)
            left, upper = int(column), int(row)
            right, lower = min(left + 1, width - 1), min(upper + 1, height - 1)
            across, down = column - left, row - upper
            for c in range(4):
                above = (1.0 - across) * texels[first + upper * width + left, c] + (
                    across * texels[first + upper * width + right, c]
                )
                below = (1.0 - across) * texels[first + lower * width + left, c] + (
                    across * texels[first + lower * width + right, c]
                )
                out[y, x, c] = np.float32(((1.0 - down) * above + down * below) / 255.0)
