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
from renderer.splats.rasteriser.tile_kernels import alpha_at, row_span
from scene.arrays import Array

_F = np.float32
_U = np.uint64
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


@numba.njit(inline="always", fastmath=True)
def _fronts_of_tile(projected, entries, start, stop, left, top, light, front, until):
    """Front to back over one tile, a row of pixels at a time: fills `front` [16 16], the splat of
    the list that shows most.

    A row of `light` [16 32] is a row of the tile: 16 transmittances, then the most that a splat
    shows.
    """
    light[:, :TILE] = 1.0
    light[:, TILE:] = 0.0
    front[:] = -1
    until[:] = stop
    for e in range(start, stop):
        i = entries[e]
        splat = projected[i]
        b, opacity = splat[CONIC_B], splat[ALPHA]
        half_a, half_c = _F(-0.5) * splat[CONIC_A], _F(-0.5) * splat[CONIC_C]
        base = left + _F(0.5) - splat[MEAN_X]
        first, last = row_span(splat, top)
        for row in range(first, last):
            if e >= until[row]:
                continue
            dy = top + _F(row) + _F(0.5) - splat[MEAN_Y]
            fall, slope = half_c * dy * dy, -b * dy
            line, chosen = light[row], front[row]
            for x in range(TILE):
                alpha = alpha_at(base + _F(x), opacity, fall, slope, half_a)
                weight = alpha * line[_U(x)] if alpha >= _F(FAINTEST) else _F(0.0)
                most = line[_U(x + TILE)]
                chosen[_U(x)] = i if weight > most else chosen[_U(x)]
                line[_U(x + TILE)] = max(weight, most)
                line[_U(x)] -= weight
        if (e - start) & 7 == 7 and not _find_decided_rows(light, until, e + 1):
            return


@numba.njit(inline="always", fastmath=True)
def _find_decided_rows(light, until, now):
    """Note in which rows nothing behind can show more; returns whether there are others."""
    some = False
    for row in range(TILE):
        if until[row] < now:
            continue
        behind = _F(-1.0)
        for x in range(TILE):
            behind = max(behind, light[row, _U(x)] - light[row, _U(x + TILE)])
        if behind < _F(0.0):
            until[row] = now
        else:
            some = True
    return some


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def fill_visibility_buffer(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    threads: int,
    front: Array,  # [H W] int32, written: row of the splat, -1 where the background shows most
) -> None:
    """Fill `front`."""
    height, width = front.shape
    tiles_x = (width + TILE - 1) // TILE
    for thread in numba.prange(threads):
        light = np.empty((TILE, 2 * TILE), np.float32)
        fronts = np.empty((TILE, TILE), np.int32)
        until = np.empty(TILE, np.int32)
        for tile in range(thread, starts.shape[0] - 1, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            _fronts_of_tile(
                projected,
                entries,
                starts[tile],
                starts[tile + 1],
                _F(x0),
                _F(y0),
                light,
                fronts,
                until,
            )
            for row in range(min(TILE, height - y0)):
                for x in range(min(TILE, width - x0)):
                    shows = light[row, x + TILE] > light[row, x]
                    front[y0 + row, x0 + x] = fronts[row, x] if shows else -1


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
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
    for pixel in numba.prange(front.shape[0]):
        x, y = columns[pixel], rows[pixel]
        front[pixel] = _front_at(projected, starts, entries, tiles_x, x, y)
