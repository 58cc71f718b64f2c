"""Which splat each pixel shows: the one that blends the most of its light into it."""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import (
    ALPHA,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    FAINTEST,
    MEAN_X,
    MEAN_Y,
    MOST_OPAQUE,
    TILE,
)
from scene.arrays import Array

_F = np.float32
_FARTHEST = math.log(FAINTEST)
"""Exponent below which even an opaque splat is too faint."""


@numba.njit(inline="always", fastmath=True)
def _front_at(projected, starts, entries, tiles_x, x, y):
    """Row of the splat that pixel (x, y) shows; -1 where the background shows most."""
    tile = (y // TILE) * tiles_x + x // TILE
    through, most, best = _F(1.0), _F(0.0), -1
    for e in range(starts[tile], starts[tile + 1]):
        splat = projected[entries[e]]
        dx, dy = _F(x) + _F(0.5) - splat[MEAN_X], _F(y) + _F(0.5) - splat[MEAN_Y]
        power = (
            _F(-0.5) * (splat[CONIC_A] * dx * dx + splat[CONIC_C] * dy * dy)
            - splat[CONIC_B] * dx * dy
        )
        if power < _F(_FARTHEST):
            continue
        alpha = min(splat[ALPHA] * math.exp(power), _F(MOST_OPAQUE))
        if alpha < FAINTEST:
            continue
        weight = alpha * through
        if weight > most:
            most, best = weight, entries[e]
        through -= weight
        if through < most:  # nothing behind can show more
            break
    return best if most > through else -1


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def fill_visibility_buffer(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    front: Array,  # [H W] int32, written: row of the splat, -1 where the background shows most
) -> None:
    """Fill `front`."""
    height, width = front.shape
    tiles_x = (width + TILE - 1) // TILE
    for tile in numba.prange(starts.shape[0] - 1):
        x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
        for y in range(y0, min(y0 + TILE, height)):
            for x in range(x0, min(x0 + TILE, width)):
                front[y, x] = _front_at(projected, starts, entries, tiles_x, x, y)


@numba.njit(fastmath=True, nogil=True, cache=True)
def front_of_pixels(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    width: int,  # of the picture, px
    rows: Array,  # [M] integers
    columns: Array,  # [M]
    front: Array,  # [M] int32, written as by `fill_visibility_buffer`
) -> None:
    """Fill `front` for some pixels."""
    tiles_x = (width + TILE - 1) // TILE
    for pixel in range(front.shape[0]):
        x, y = columns[pixel], rows[pixel]
        front[pixel] = _front_at(projected, starts, entries, tiles_x, x, y)
