"""A picture's detail on a view, pixel by pixel."""

from __future__ import annotations

import numba
import numpy as np

from renderer.splats.layout import (
    ALPHA,
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    GREEN,
    MEAN_X,
    MEAN_Y,
    RED,
    TILE,
)
from renderer.splats.rasteriser.tile_kernels import alpha_at, find_saturated_rows, row_span
from scene.arrays import Array

_F = np.float32
_U = np.uint64
WHOLE = 0.7
"""Share of a pixel that must be seen by the webcam for all of its detail: what shines through from
behind is not."""
_LEAST = 1.0 / 256.0
"""Share below which nothing is laid."""


@numba.njit(inline="always", fastmath=True)
def _lay_pixel(pixel, across, down, seen, detail, step, most, x, y):
    """Multiply a pixel (premultiplied) by the detail of its place, as far as it is `seen`."""
    rows, columns = detail.shape[0], detail.shape[1]
    alpha = pixel[3]
    share = most * min(seen / (_F(WHOLE) * alpha), _F(1.0))
    # pixels' centres are at halves
    across = across / seen + step * (_F(x) + _F(0.5)) - _F(0.5)
    down = down / seen + step * (_F(y) + _F(0.5)) - _F(0.5)
    across = min(max(across, _F(0.0)), _F(columns - 1))
    down = min(max(down, _F(0.0)), _F(rows - 1))
    left, top = _U(across), _U(down)
    right = min(left + _U(1), _U(columns - 1))
    bottom = min(top + _U(1), _U(rows - 1))
    fx, fy = across - _F(left), down - _F(top)
    for c in range(3):
        upper = detail[top, left, c] + fx * (detail[top, right, c] - detail[top, left, c])
        lower = detail[bottom, left, c] + fx * (detail[bottom, right, c] - detail[bottom, left, c])
        factor = upper + fy * (lower - upper)
        pixel[c] = min(pixel[c] * (_F(1.0) + share * (factor - _F(1.0))), alpha)


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def lay(
    view: Array,  # [H W 4] float32, changed: premultiplied sRGB and alpha
    blended: Array,  # [H W 4] float32: `values_to_blend`, blended as colours are
    detail: Array,  # [h w 3] float32
    scale: float,  # px of the picture for one of the view
    strength: float,
) -> None:
    """Multiply `view` by the detail of the place that each pixel has in the picture."""
    for y in numba.prange(view.shape[0]):
        for x in range(view.shape[1]):
            place = blended[y, x]
            if place[2] >= _F(_LEAST):
                _lay_pixel(
                    view[y, x], place[0], place[1], place[2], detail, _F(scale), _F(strength), x, y
                )


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def draw_and_lay(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    values: Array,  # [N 3] float32: `values_to_blend`
    detail: Array,  # [h w 3] float32
    scale: float,  # px of the picture for one of the view
    strength: float,
    threads: int,
    out: Array,  # [H W 4] float32, written: premultiplied RGBA
) -> None:
    """`tile_kernels.draw` and `lay` in one, in less time than the former takes twice."""
    height, width = out.shape[0], out.shape[1]
    tiles_x = (width + TILE - 1) // TILE
    tiles = starts.shape[0] - 1
    for thread in numba.prange(threads):
        sums = np.empty((TILE, 7 * TILE), np.float32)
        until = np.empty(TILE, np.int32)
        for tile in range(thread, tiles, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            rows, columns = min(TILE, height - y0), min(TILE, width - x0)
            begin, end = starts[tile], starts[tile + 1]
            if begin == end:
                out[y0 : y0 + rows, x0 : x0 + columns] = 0.0
                continue
            _blend_tile(projected, entries, values, begin, end, _F(x0), _F(y0), sums, until)
            for row in range(rows):
                for x in range(columns):
                    pixel = out[y0 + row, x0 + x]
                    for c in range(3):
                        pixel[c] = sums[row, x + (c + 1) * TILE]
                    pixel[3] = _F(1.0) - sums[row, x]
                    seen = sums[row, x + 6 * TILE]
                    if seen < _F(_LEAST):
                        continue
                    across, down = sums[row, x + 4 * TILE], sums[row, x + 5 * TILE]
                    step, most = _F(scale), _F(strength)
                    _lay_pixel(pixel, across, down, seen, detail, step, most, x0 + x, y0 + row)


@numba.njit(inline="always", fastmath=True)
def _blend_tile(projected, entries, values, start, stop, left, top, sums, until):
    """As `tile_kernels._blend_tile`, of colours and of `values`: a row of `sums` [16 112] goes on
    with those."""
    sums[:, :TILE] = 1.0
    sums[:, TILE:] = 0.0
    until[:] = stop
    for e in range(start, stop):
        splat, value = projected[entries[e]], values[entries[e]]
        red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
        across, down, seen = value[0], value[1], value[2]
        b, opacity = splat[CONIC_B], splat[ALPHA]
        half_a, half_c = _F(-0.5) * splat[CONIC_A], _F(-0.5) * splat[CONIC_C]
        base = left + _F(0.5) - splat[MEAN_X]
        first, last = row_span(splat, top)
        for row in range(first, last):
            if e >= until[row]:
                continue
            dy = top + _F(row) + _F(0.5) - splat[MEAN_Y]
            fall, slope = half_c * dy * dy, -b * dy
            line = sums[row]
            for x in range(TILE):
                dx = base + _F(x)
                alpha = alpha_at(dx, opacity, fall, slope, half_a)
                weight = alpha * line[_U(x)]
                line[_U(x)] -= weight
                line[_U(x + TILE)] += weight * red
                line[_U(x + 2 * TILE)] += weight * green
                line[_U(x + 3 * TILE)] += weight * blue
                line[_U(x + 4 * TILE)] += weight * across
                line[_U(x + 5 * TILE)] += weight * down
                line[_U(x + 6 * TILE)] += weight * seen
        if (e - start) & 15 == 15 and not find_saturated_rows(sums, until, e + 1):
            return
