"""From pixels back to splats: how far each splat's own pixels are from what they should show.

Each splat gets the mean of the differences of its pixels, each weighted by how much of the splat it
shows. Added to the colours that is one step of SIRT (Gilbert 1972), which tomography uses to find
what a picture is the sum of: the steps end at the colours with which the picture is nearest.
"""

from __future__ import annotations

import numba
import numpy as np

from renderer.splats.layout import (
    ALPHA,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    GATHERED,
    MEAN_X,
    MEAN_Y,
    TILE,
)
from renderer.splats.rasteriser.tile_kernels import _blend_tile, alpha_at, row_span
from scene.arrays import Array

_F = np.float32
_U = np.uint64


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def gather_differences(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    wanted: Array,  # [H W 4] float32: colour, not premultiplied, and how well it is known, 0 to 1
    most: float,  # a difference counts as no larger
    gathered: Array,  # [threads N 5] float32, must be nil; added to
) -> None:
    """Sum what splats lack in their pixels."""
    tiles_x = (wanted.shape[1] + TILE - 1) // TILE
    tiles = starts.shape[0] - 1
    threads = gathered.shape[0]
    for thread in numba.prange(threads):
        sums = np.empty((TILE, 4 * TILE), np.float32)
        until = np.empty(TILE, np.int32)
        state = np.empty((TILE, 5 * TILE), np.float32)
        lanes = np.empty(GATHERED * TILE, np.float32)
        for tile in range(thread, tiles, threads):
            begin, end = starts[tile], starts[tile + 1]
            if begin == end:
                continue
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            end = _blend_tile(projected, entries, begin, end, _F(x0), _F(y0), sums, until)
            _lacking(wanted, _F(most), x0, y0, sums, state)
            _gather_tile(
                projected, entries, begin, end, _F(x0), _F(y0), until, state, lanes,
                gathered[thread],
            )  # fmt: skip


@numba.njit(inline="always", fastmath=True)
def _lacking(wanted, most, x0, y0, sums, state):
    """Fill `state` [16 80]: transmittance 1, what each pixel lacks (3), how well that is known.

    A pixel counts by how much of it is covered, with the colour of what covers it.
    """
    height, width = wanted.shape[0], wanted.shape[1]
    state[:, :TILE] = 1.0
    state[:, TILE:] = 0.0
    for row in range(min(TILE, height - y0)):
        for x in range(min(TILE, width - x0)):
            covered = _F(1.0) - sums[row, x]
            known = wanted[y0 + row, x0 + x, 3] * covered
            if known <= 0.0:
                continue
            for k in range(3):
                lacks = wanted[y0 + row, x0 + x, k] - sums[row, x + (k + 1) * TILE] / covered
                state[row, x + (k + 1) * TILE] = known * max(-most, min(lacks, most))
            state[row, x + 4 * TILE] = known


@numba.njit(inline="always", fastmath=True)
def _gather_tile(projected, entries, begin, end, left, top, until, state, lanes, gathered):
    """Front to back again: each splat's share of its pixels' differences."""
    for e in range(begin, end):
        i = entries[e]
        splat = projected[i]
        b, opacity = splat[CONIC_B], splat[ALPHA]
        half_a, half_c = _F(-0.5) * splat[CONIC_A], _F(-0.5) * splat[CONIC_C]
        base = left + _F(0.5) - splat[MEAN_X]
        lanes[:] = 0.0
        first, last = row_span(splat, top)
        for row in range(first, last):
            if e >= until[row]:
                continue
            dy = top + _F(row) + _F(0.5) - splat[MEAN_Y]
            fall, slope = half_c * dy * dy, -b * dy
            line = state[row]
            for x in range(TILE):
                dx = base + _F(x)
                alpha = alpha_at(dx, opacity, fall, slope, half_a)
                weight = alpha * line[_U(x)]
                line[_U(x)] -= weight
                lanes[_U(x)] += weight * line[_U(x + TILE)]
                lanes[_U(x + TILE)] += weight * line[_U(x + 2 * TILE)]
                lanes[_U(x + 2 * TILE)] += weight * line[_U(x + 3 * TILE)]
                lanes[_U(x + 3 * TILE)] += weight * line[_U(x + 4 * TILE)]
                lanes[_U(x + 4 * TILE)] += weight
        for k in range(GATHERED):
            total = _F(0.0)
            for x in range(TILE):
                total += lanes[_U(k * TILE + x)]
            gathered[i, k] += total
