"""Sort splats by depth, hand them to 16x16 tiles, blend front to back; and the way back.

A tile's row of 16 pixels is the innermost loop, written so that it becomes vector code: no branch,
contiguous float32, a fixed count; one float64 or int64 in it halves the speed. Forward, loss and
backward of a tile follow one another while it is in cache. Each thread has its own gradient buffer,
so no atomics are needed and sums are repeatable for a given number of threads.
"""

from __future__ import annotations

import numba
import numpy as np

from renderer.exp_kernels import exp_falling
from renderer.splats.layout import (
    ALPHA,
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    CONTRIBUTION,
    EMPTY_BOX,
    FINISHED,
    GREEN,
    HALF_HEIGHT,
    MEAN_X,
    MEAN_Y,
    MOST_OPAQUE,
    RED,
    TILE,
)
from scene.arrays import Array

_F = np.float32
_U = np.uint64
"""An index that can't be negative: loads and stores stay in vectors."""
_DEPTH_BINS = 4096
"""Steps of depth that the counting sort tells apart: under a millimetre over a body's depth."""


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
def _row_span(splat, top):
    """First and past-last row of the tile that has a pixel the splat can be seen in."""
    middle, half = splat[MEAN_Y] - top + _F(0.5), splat[HALF_HEIGHT]
    first = min(max(middle - half, _F(0.0)), _F(TILE))
    last = min(max(middle + half, _F(0.0)), _F(TILE))
    return np.int32(first), np.int32(last)


@numba.njit(inline="always", fastmath=True)
def _blend_tile(projected, entries, start, stop, left, top, sums, open_rows):
    """Front to back over one tile: fills `sums`; returns where in the list it was finished.

    A row of `sums` [16 64] is a row of the tile: 16 transmittances, then red, green and blue. They
    lie in one line so that the compiler sees that they don't overlap and keeps vectors.
    """
    sums[:, :TILE] = 1.0
    sums[:, TILE:] = 0.0
    open_rows[:] = True
    for e in range(start, stop):
        splat = projected[entries[e]]
        red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
        b, opacity = splat[CONIC_B], splat[ALPHA]
        half_a, half_c = _F(-0.5) * splat[CONIC_A], _F(-0.5) * splat[CONIC_C]
        base = left + _F(0.5) - splat[MEAN_X]
        first, last = _row_span(splat, top)
        for row in range(first, last):
            if not open_rows[row]:
                continue
            dy = top + _F(row) + _F(0.5) - splat[MEAN_Y]
            fall, slope = half_c * dy * dy, -b * dy
            line = sums[row]
            for x in range(TILE):
                dx = base + _F(x)
                power = min(fall + dx * (slope + half_a * dx), _F(0.0))
                alpha = min(opacity * exp_falling(power), _F(MOST_OPAQUE))
                weight = alpha * line[_U(x)]
                line[_U(x)] -= weight
                line[_U(x + TILE)] += weight * red
                line[_U(x + 2 * TILE)] += weight * green
                line[_U(x + 3 * TILE)] += weight * blue
        if (e - start) & 15 == 15 and not _look_again(sums, open_rows):
            return e + 1
    return stop


@numba.njit(inline="always", fastmath=True)
def _look_again(sums, open_rows):
    """Note which rows still let light through; returns whether any does."""
    some = False
    for row in range(TILE):
        most = _F(0.0)
        for x in range(TILE):
            most = max(most, sums[row, _U(x)])
        open_rows[row] = most >= _F(FINISHED)
        some |= open_rows[row]
    return some


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
        sums = np.empty((TILE, 4 * TILE), np.float32)
        open_rows = np.empty(TILE, np.bool_)
        for tile in range(thread, tiles, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            rows, columns = min(TILE, height - y0), min(TILE, width - x0)
            if starts[tile] == starts[tile + 1]:
                out[y0 : y0 + rows, x0 : x0 + columns] = 0.0
                continue
            _blend_tile(
                projected, entries, starts[tile], starts[tile + 1], _F(x0), _F(y0), sums, open_rows
            )
            for row in range(rows):
                line = out[y0 + row]
                for x in range(columns):
                    line[x0 + x, 0] = sums[row, x + TILE]
                    line[x0 + x, 1] = sums[row, x + 2 * TILE]
                    line[x0 + x, 2] = sums[row, x + 3 * TILE]
                    line[x0 + x, 3] = _F(1.0) - sums[row, x]


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def draw_and_differentiate(
    projected: Array,  # [N Q] float32
    starts: Array,  # [tiles + 1] int32
    entries: Array,  # [lists] int32
    target: Array,  # [H W 4] uint8: premultiplied sRGB and alpha
    background: Array,  # [3] float32
    linear_from: float,
    gradients: Array,  # [threads N Q] float32, must be nil; added to
    losses: Array,  # [threads] float64, written: summed over channels and pixels
) -> None:
    """Loss of the splats over `background` against the target over it, and its gradient.

    Huber's, of each channel's difference d (Huber 1964): d^2 / 2w up to w = `linear_from`, then
    |d| - w / 2.
    """
    width_of_square = _F(linear_from)
    threads = gradients.shape[0]
    width = target.shape[1]
    tiles_x = (width + TILE - 1) // TILE
    tiles = starts.shape[0] - 1
    for thread in numba.prange(threads):
        sums = np.empty((TILE, 4 * TILE), np.float32)
        open_rows = np.empty(TILE, np.bool_)
        through = np.empty((TILE, TILE), np.float32)
        slopes = np.empty((3, TILE, TILE), np.float32)
        behind = np.empty((TILE, TILE), np.float32)
        alphas = np.empty(TILE, np.float32)
        loss = 0.0
        for tile in range(thread, tiles, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            begin, end = starts[tile], starts[tile + 1]
            end = _blend_tile(projected, entries, begin, end, _F(x0), _F(y0), sums, open_rows)
            loss += _compare(target, background, width_of_square, x0, y0, sums, slopes, behind)
            if end > begin:
                _differentiate_tile(
                    projected, entries, begin, end, _F(x0), _F(y0),
                    through, slopes, behind, alphas, gradients[thread],
                )  # fmt: skip
        losses[thread] = loss


@numba.njit(inline="always", fastmath=True)
def _compare(target, background, width_of_square, x0, y0, sums, slopes, behind):
    """Loss of one tile; fills its slopes by colour and, a pixel, their sum over all behind."""
    height, width = target.shape[0], target.shape[1]
    loss = _F(0.0)
    slopes[:] = 0.0
    behind[:] = 0.0
    for row in range(min(TILE, height - y0)):
        for x in range(min(TILE, width - x0)):
            uncovered = _F(1.0) - _F(target[y0 + row, x0 + x, 3]) * _F(1.0 / 255.0)
            for k in range(3):
                wanted = (
                    _F(target[y0 + row, x0 + x, k]) * _F(1.0 / 255.0) + uncovered * background[k]
                )
                shown = sums[row, x + (k + 1) * TILE] + sums[row, x] * background[k]
                difference = shown - wanted
                s = max(_F(-1.0), min(difference / width_of_square, _F(1.0)))
                loss += s * (difference - _F(0.5) * s * width_of_square)
                slopes[k, row, x] = s
                behind[row, x] += s * shown
    return loss


@numba.njit(inline="always", fastmath=True)
def _differentiate_tile(projected, entries, begin, end, left, top, through, slopes, behind,
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
            fall, slope = _F(-0.5) * c * dy * dy, -b * dy
            for x in range(TILE):
                dx = base + _F(x)
                power = min(fall + dx * (slope - _F(0.5) * a * dx), _F(0.0))
                alphas[x] = min(opacity * exp_falling(power), _F(MOST_OPAQUE))
            t, rest = through[row], behind[row]
            g_r, g_g, g_b = slopes[0, row], slopes[1, row], slopes[2, row]
            row_p, row_px, row_pxx = _F(0.0), _F(0.0), _F(0.0)
            for x in range(TILE):
                alpha = alphas[x]
                weight = alpha * t[x]
                light = red * g_r[x] + green * g_g[x] + blue * g_b[x]
                rest[x] -= weight * light
                by_alpha = t[x] * light - rest[x] / (_F(1.0) - alpha)
                # a clamped opacity does not move with the splat
                by_power = by_alpha * alpha if alpha < _F(MOST_OPAQUE) else _F(0.0)
                s_r += weight * g_r[x]
                s_g += weight * g_g[x]
                s_b += weight * g_b[x]
                s_w += weight
                dx = base + _F(x)
                row_p += by_power
                row_px += by_power * dx
                row_pxx += by_power * dx * dx
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
