"""Compiled look-up of how far outside a mask projected points lie."""

from __future__ import annotations

import math

import numba

from scene.arrays import Array


@numba.njit(cache=True, nogil=True)
def look_up(
    pixels: Array,
    distance: Array,
    known: Array,
    corner_and_scale: tuple[float, float, float],
    size: tuple[int, int],
    outside: Array,
    slopes: Array,
) -> None:
    """Distance [F V] of `pixels` [F V 2] to the mask, px, and by how much it grows to the right and
    downwards [F V 2]; nought inside it, outside the picture of `size` (width, height), and where
    the frame has no mask (`known` [F]).

    `distance` [F h w 3] is that of `Silhouettes`, in a window that begins at x, y of the picture
    and has `scale` pixels for each of its.
    """
    left, top, scale = corner_and_scale
    height, width = distance.shape[1:3]
    for f in range(len(pixels)):
        for v in range(pixels.shape[1]):
            x, y = pixels[f, v, 0], pixels[f, v, 1]
            outside[f, v] = slopes[f, v, 0] = slopes[f, v, 1] = 0.0
            if known[f] == 0.0 or not (0.0 < x < size[0] and 0.0 < y < size[1]):
                continue
            x, y = (x - left) * scale, (y - top) * scale
            column = min(max(math.floor(x), 0), width - 1)
            row = min(max(math.floor(y), 0), height - 1)
            near = distance[f, row, column]
            found = near[0] + near[1] * (x - column - 0.5) + near[2] * (y - row - 0.5)
            if found > 0.0:
                outside[f, v] = found / scale
                slopes[f, v, 0], slopes[f, v, 1] = near[1], near[2]
