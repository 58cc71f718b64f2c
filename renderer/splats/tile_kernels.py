"""Sort splats by depth, hand them to 16x16 tiles, blend front to back; and the way back.

A tile's row of 16 pixels is the innermost loop, written so that it becomes vector code: no branch,
contiguous float32, a fixed count. Forward, loss and backward of a tile follow one another while it
is in cache. Each thread has its own gradient buffer, so no atomics are needed and sums are
repeatable for a given number of threads.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import (
    ALPHA,
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    CONTRIBUTION,
    EMPTY_BOX,
    FAINTEST,
    GREEN,
    MEAN_X,
    MEAN_Y,
    MOST_OPAQUE,
    RED,
    TILE,
)
from scene.arrays import Array

_F = np.float32
_DEPTH_BINS = 4096
"""Steps of depth that the counting sort tells apart: under a millimetre over a body's depth."""
_OPAQUE = 1.0 / 512.0
"""A tile whose every pixel lets less through is finished."""


@numba.njit(inline="always", fastmath=True)
def _exp(x):
    """e^x for x <= 0, relative error under 4e-5: 2^n by exponent bits times a polynomial."""
    y = max(x, _F(-80.0)) * _F(1.4426950408889634)
    whole = math.floor(y)
    f = y - whole
    p = _F(1.0) + f * (
        _F(0.69314718)
        + f * (_F(0.24022651) + f * (_F(0.0555041) + f * (_F(0.00961813) + f * _F(0.00133336))))
    )
    return p * np.int32((np.int32(whole) + np.int32(127)) << np.int32(23)).view(np.float32)


@numba.njit(nogil=True, cache=True)
def depth_order(depth: Array, boxes: Array, order: Array) -> int:
    """Drawn splats by rising depth into `order`, by counting sort; returns how many."""
    low, high = _F(1e30), _F(-1e30)
    for i in range(depth.shape[0]):
        if boxes[i, 0] != EMPTY_BOX:
            low, high = min(low, depth[i]), max(high, depth[i])
    if high < low:
        return 0
    scale = _F(_DEPTH_BINS - 1) / max(high - low, _F(1e-6))
    starts = np.zeros(_DEPTH_BINS + 1, np.int32)
    for i in range(depth.shape[0]):
        if boxes[i, 0] != EMPTY_BOX:
            starts[int((depth[i] - low) * scale) + 1] += 1
    for b in range(_DEPTH_BINS):
        starts[b + 1] += starts[b]
    total = int(starts[_DEPTH_BINS])
    for i in range(depth.shape[0]):
        if boxes[i, 0] != EMPTY_BOX:
            b = int((depth[i] - low) * scale)
            order[starts[b]] = i
            starts[b] += 1
    return total


@numba.njit(nogil=True, cache=True)
def count_entries(boxes: Array, order: Array, drawn: int, tiles_x: int, starts: Array) -> int:
    """Fill `starts` [tiles + 1] with where each tile's list begins; returns the lists' length."""
    starts[:] = 0
    for n in range(drawn):
        i = order[n]
        for ty in range(boxes[i, 2], boxes[i, 3] + 1):
            for tx in range(boxes[i, 0], boxes[i, 1] + 1):
                starts[ty * tiles_x + tx + 1] += 1
    for t in range(starts.shape[0] - 1):
        starts[t + 1] += starts[t]
    return int(starts[starts.shape[0] - 1])


@numba.njit(nogil=True, cache=True)
def fill_entries(
    boxes: Array, order: Array, drawn: int, tiles_x: int, starts: Array, fill: Array, entries: Array
) -> None:
    """Write each tile's splats, front to back, into `entries` [at least the lists' length]."""
    fill[:] = starts[:-1]
    for n in range(drawn):
        i = order[n]
        for ty in range(boxes[i, 2], boxes[i, 3] + 1):
            for tx in range(boxes[i, 0], boxes[i, 1] + 1):
                t = ty * tiles_x + tx
                entries[fill[t]] = i
                fill[t] += 1


@numba.njit(inline="always", fastmath=True)
def _alphas(splat, left, dy, alphas):
    """Opacities of one row of 16 pixels; returns False where none of them can be seen."""
    a, b, c, opacity = splat[CONIC_A], splat[CONIC_B], splat[CONIC_C], splat[ALPHA]
    # the row's peak of -0.5 d^T C d lies where a dx + b dy = 0
    peak = _F(-0.5) * (c - b * b / a) * dy * dy
    if opacity * math.exp(peak) < FAINTEST:
        return False
    base = left + _F(0.5) - splat[MEAN_X]
    half_c = _F(-0.5) * c * dy * dy
    slope = -b * dy
    for x in range(TILE):
        dx = base + _F(x)
        power = half_c + dx * (slope - _F(0.5) * a * dx)
        alphas[x] = min(opacity * _exp(min(power, _F(0.0))), _F(MOST_OPAQUE))
    return True


@numba.njit(inline="always", fastmath=True)
def _row_span(splat, top):
    """First and past-last row of the tile that the splat can touch."""
    a, b, c = splat[CONIC_A], splat[CONIC_B], splat[CONIC_C]
    determinant = max(a * c - b * b, _F(1e-20))
    half = math.sqrt(_F(2.0) * math.log(splat[ALPHA] / _F(FAINTEST)) * a / determinant)
    first = max(0, math.floor(splat[MEAN_Y] - half - top - _F(0.5)))
    last = min(TILE, math.ceil(splat[MEAN_Y] + half - top + _F(0.5)))
    return first, last


@numba.njit(inline="always", fastmath=True)
def _blend_tile(projected, entries, start, stop, left, top, through, colour, alphas):
    """Front to back over one tile: fills transmittance [16 16] and colour [3 16 16]."""
    through[:] = 1.0
    colour[:] = 0.0
    for e in range(start, stop):
        splat = projected[entries[e]]
        red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
        first, last = _row_span(splat, top)
        for row in range(first, last):
            dy = top + _F(row) + _F(0.5) - splat[MEAN_Y]
            if not _alphas(splat, left, dy, alphas):
                continue
            t, r, g, b = through[row], colour[0, row], colour[1, row], colour[2, row]
            for x in range(TILE):
                weight = alphas[x] * t[x]
                r[x] += weight * red
                g[x] += weight * green
                b[x] += weight * blue
                t[x] -= weight
        if (e - start) & 15 == 15 and through.max() < _OPAQUE:
            return e + 1
    return stop


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def draw(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    threads: int,
    out: Array,  # [H W 4] float32, written: premultiplied RGBA
) -> None:
    """Blend all tiles into `out`."""
    height, width = out.shape[0], out.shape[1]
    tiles_x = (width + TILE - 1) // TILE
    tiles = starts.shape[0] - 1
    for thread in numba.prange(threads):
        through = np.empty((TILE, TILE), np.float32)
        colour = np.empty((3, TILE, TILE), np.float32)
        alphas = np.empty(TILE, np.float32)
        for tile in range(thread, tiles, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            rows, columns = min(TILE, height - y0), min(TILE, width - x0)
            if starts[tile] == starts[tile + 1]:
                out[y0 : y0 + rows, x0 : x0 + columns] = 0.0
                continue
            _blend_tile(
                projected, entries, starts[tile], starts[tile + 1], _F(x0), _F(y0),
                through, colour, alphas,
            )  # fmt: skip
            for row in range(rows):
                line = out[y0 + row]
                for x in range(columns):
                    line[x0 + x, 0] = colour[0, row, x]
                    line[x0 + x, 1] = colour[1, row, x]
                    line[x0 + x, 2] = colour[2, row, x]
                    line[x0 + x, 3] = _F(1.0) - through[row, x]


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def draw_and_differentiate(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    target: Array,  # [H W 4] uint8: premultiplied sRGB and alpha
    background: Array,  # [3] float32
    gradients: Array,  # [threads N Q+1] float32, must be nil; added to
    losses: Array,  # [threads] float64, written: summed absolute difference
) -> None:
    """L1 loss of the splats over `background` against the target over it, and its gradient."""
    threads = gradients.shape[0]
    width = target.shape[1]
    tiles_x = (width + TILE - 1) // TILE
    tiles = starts.shape[0] - 1
    for thread in numba.prange(threads):
        through = np.empty((TILE, TILE), np.float32)
        colour = np.empty((3, TILE, TILE), np.float32)
        sign = np.empty((3, TILE, TILE), np.float32)
        behind = np.empty((TILE, TILE), np.float32)
        alphas = np.empty(TILE, np.float32)
        loss = 0.0
        for tile in range(thread, tiles, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            begin, end = starts[tile], starts[tile + 1]
            end = _blend_tile(
                projected, entries, begin, end, _F(x0), _F(y0), through, colour, alphas
            )
            loss += _compare(target, background, x0, y0, through, colour, sign, behind)
            if end > begin:
                _differentiate_tile(
                    projected, entries, begin, end, _F(x0), _F(y0),
                    through, sign, behind, alphas, gradients[thread],
                )  # fmt: skip
        losses[thread] = loss


@numba.njit(inline="always", fastmath=True)
def _compare(target, background, x0, y0, through, colour, sign, behind):
    """L1 of one tile; fills its gradient's sign and, a pixel, sum of sign * all colour behind."""
    height, width = target.shape[0], target.shape[1]
    loss = _F(0.0)
    sign[:] = 0.0
    behind[:] = 0.0
    for row in range(min(TILE, height - y0)):
        for x in range(min(TILE, width - x0)):
            uncovered = _F(1.0) - _F(target[y0 + row, x0 + x, 3]) * _F(1.0 / 255.0)
            for k in range(3):
                wanted = (
                    _F(target[y0 + row, x0 + x, k]) * _F(1.0 / 255.0) + uncovered * background[k]
                )
                shown = colour[k, row, x] + through[row, x] * background[k]
                difference = shown - wanted
                loss += abs(difference)
                s = _F(1.0) if difference > 0 else (_F(-1.0) if difference < 0 else _F(0.0))
                sign[k, row, x] = s
                behind[row, x] += s * shown
    return loss


@numba.njit(inline="always", fastmath=True)
def _differentiate_tile(projected, entries, begin, end, left, top, through, sign, behind,
                        alphas, gradient):  # fmt: skip
    """Front to back again: what lies behind a splat is the total less what has been passed."""
    through[:] = 1.0
    for e in range(begin, end):
        i = entries[e]
        splat = projected[i]
        red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
        a, b, c, opacity = splat[CONIC_A], splat[CONIC_B], splat[CONIC_C], splat[ALPHA]
        base = left + _F(0.5) - splat[MEAN_X]
        s_r, s_g, s_b, s_w = _F(0.0), _F(0.0), _F(0.0), _F(0.0)
        s_x, s_y, s_o = _F(0.0), _F(0.0), _F(0.0)
        s_xx, s_xy, s_yy = _F(0.0), _F(0.0), _F(0.0)
        first, last = _row_span(splat, top)
        for row in range(first, last):
            dy = top + _F(row) + _F(0.5) - splat[MEAN_Y]
            if not _alphas(splat, left, dy, alphas):
                continue
            t, rest = through[row], behind[row]
            g_r, g_g, g_b = sign[0, row], sign[1, row], sign[2, row]
            row_p, row_px, row_pxx = _F(0.0), _F(0.0), _F(0.0)
            for x in range(TILE):
                alpha = alphas[x]
                weight = alpha * t[x]
                light = red * g_r[x] + green * g_g[x] + blue * g_b[x]
                rest[x] -= weight * light
                by_alpha = t[x] * light - rest[x] / (_F(1.0) - alpha)
                # a clamped opacity does not move with the splat
                power = by_alpha * alpha if alpha < _F(MOST_OPAQUE) else _F(0.0)
                s_r += weight * g_r[x]
                s_g += weight * g_g[x]
                s_b += weight * g_b[x]
                s_w += weight
                dx = base + _F(x)
                row_p += power
                row_px += power * dx
                row_pxx += power * dx * dx
                t[x] -= weight
            s_o += row_p
            s_x += a * row_px + b * dy * row_p
            s_y += b * row_px + c * dy * row_p
            s_xx += row_pxx
            s_xy += dy * row_px
            s_yy += dy * dy * row_p
        out = gradient[i]
        out[MEAN_X] += s_x
        out[MEAN_Y] += s_y
        out[CONIC_A] += _F(-0.5) * s_xx
        out[CONIC_B] -= s_xy
        out[CONIC_C] += _F(-0.5) * s_yy
        out[ALPHA] += s_o / opacity
        out[RED] += s_r
        out[GREEN] += s_g
        out[BLUE] += s_b
        out[CONTRIBUTION] += s_w
