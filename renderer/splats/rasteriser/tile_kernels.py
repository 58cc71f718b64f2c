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
    UNKNOWN,
)
from scene.arrays import Array

_F = np.float32
_U = np.uint64
"""An index that can't be negative: loads and stores stay in vectors."""
_FARTHEST = -40.0
"""Exponent that no pixel falls below: products of what is fainter are subnormal numbers, by which
drawing takes 1.4 times as long on an EPYC, and the way back twice."""
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
def alpha_at(dx, opacity, fall, slope, half_a):
    """What a splat hides of a pixel, `dx` px right of its mean, on a row with this `fall` and
    `slope` of the exponent."""
    power = max(min(fall + dx * (slope + half_a * dx), _F(0.0)), _F(_FARTHEST))
    return min(opacity * exp_falling(power), _F(MOST_OPAQUE))


@numba.njit(inline="always", fastmath=True)
def row_span(splat, top):
    """First and past-last row of the tile that has a pixel the splat can be seen in."""
    middle, half = splat[MEAN_Y] - top + _F(0.5), splat[HALF_HEIGHT]
    first = min(max(middle - half, _F(0.0)), _F(TILE))
    last = min(max(middle + half, _F(0.0)), _F(TILE))
    return np.int32(first), np.int32(last)


@numba.njit(inline="always", fastmath=True)
def _blend_tile(projected, entries, start, stop, left, top, sums, until):
    """Front to back over one tile: fills `sums`; returns where in the list it was finished.

    A row of `sums` [16 64] is a row of the tile: 16 transmittances, then red, green and blue. They
    lie in one line so that the compiler sees that they don't overlap and keeps vectors. `until`
    [16] is filled too: where in the list each row was finished.
    """
    sums[:, :TILE] = 1.0
    sums[:, TILE:] = 0.0
    until[:] = stop
    for e in range(start, stop):
        splat = projected[entries[e]]
        red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
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
        if (e - start) & 15 == 15 and not find_saturated_rows(sums, until, e + 1):
            return e + 1
    return stop


@numba.njit(inline="always", fastmath=True)
def find_saturated_rows(sums, until, now):
    """Note which rows let no more light through; returns whether any does."""
    some = False
    for row in range(TILE):
        if until[row] < now:
            continue
        most = _F(0.0)
        for x in range(TILE):
            most = max(most, sums[row, _U(x)])
        if most < _F(FINISHED):
            until[row] = now
        else:
            some = True
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
        until = np.empty(TILE, np.int32)
        for tile in range(thread, tiles, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            rows, columns = min(TILE, height - y0), min(TILE, width - x0)
            if starts[tile] == starts[tile + 1]:
                out[y0 : y0 + rows, x0 : x0 + columns] = 0.0
                continue
            _blend_tile(
                projected, entries, starts[tile], starts[tile + 1], _F(x0), _F(y0), sums, until
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
    target: Array,  # [H W 4] uint8: premultiplied sRGB and alpha, or UNKNOWN
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
        until = np.empty(TILE, np.int32)
        state = np.empty((TILE, 5 * TILE), np.float32)
        lanes = np.empty(7 * TILE, np.float32)
        loss = 0.0
        for tile in range(thread, tiles, threads):
            x0, y0 = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            begin, end = starts[tile], starts[tile + 1]
            end = _blend_tile(projected, entries, begin, end, _F(x0), _F(y0), sums, until)
            loss += _compare(target, background, width_of_square, x0, y0, sums, state)
            if end > begin:
                _differentiate_tile(
                    projected,
                    entries,
                    begin,
                    end,
                    _F(x0),
                    _F(y0),
                    until,
                    state,
                    lanes,
                    gradients[thread],
                )
        losses[thread] = loss


@numba.njit(inline="always", fastmath=True)
def _compare(target, background, width_of_square, x0, y0, sums, state):
    """Loss of one tile; fills of its `state` what lies behind, and the slopes by colour."""
    height, width = target.shape[0], target.shape[1]
    loss = _F(0.0)
    state[:, TILE:] = 0.0
    for row in range(min(TILE, height - y0)):
        for x in range(min(TILE, width - x0)):
            alpha, red = target[y0 + row, x0 + x, 3], target[y0 + row, x0 + x, 0]
            known = _F(1.0) - _F((alpha == UNKNOWN[3]) & (red == UNKNOWN[0]))
            uncovered = _F(1.0) - _F(alpha) * _F(1.0 / 255.0)
            for k in range(3):
                wanted = (
                    _F(target[y0 + row, x0 + x, k]) * _F(1.0 / 255.0) + uncovered * background[k]
                )
                shown = sums[row, x + (k + 1) * TILE] + sums[row, x] * background[k]
                difference = shown - wanted
                s = known * max(_F(-1.0), min(difference / width_of_square, _F(1.0)))
                loss += s * (difference - _F(0.5) * s * width_of_square)
                state[row, x + (k + 2) * TILE] = s
                state[row, x + TILE] += s * shown
    return loss


@numba.njit(inline="always", fastmath=True)
def _differentiate_tile(projected, entries, begin, end, left, top, until, state, lanes, gradient):
    """Front to back again: what lies behind a splat is the total less what has been passed.

    A row of `state` [16 80] is a row of the tile: transmittance, what lies behind, three slopes.
    `lanes` [112] sums over rows what is summed over columns once a splat: per column, the slopes
    by red, green, blue, contribution, and by the exponent times 1, dy and dy^2.
    """
    state[:, :TILE] = 1.0
    for e in range(begin, end):
        i = entries[e]
        splat = projected[i]
        red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
        a, b, c, opacity = splat[CONIC_A], splat[CONIC_B], splat[CONIC_C], splat[ALPHA]
        half_a, half_c = _F(-0.5) * a, _F(-0.5) * c
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
                t = line[_U(x)]
                weight = alpha * t
                g_r, g_g, g_b = (
                    line[_U(x + 2 * TILE)],
                    line[_U(x + 3 * TILE)],
                    line[_U(x + 4 * TILE)],
                )
                light = red * g_r + green * g_g + blue * g_b
                rest = line[_U(x + TILE)] - weight * light
                line[_U(x)] = t - weight
                line[_U(x + TILE)] = rest
                by_alpha = t * light - rest / (_F(1.0) - alpha)
                # a clamped opacity does not move with the splat
                by_power = by_alpha * alpha if alpha < _F(MOST_OPAQUE) else _F(0.0)
                lanes[_U(x)] += weight * g_r
                lanes[_U(x + TILE)] += weight * g_g
                lanes[_U(x + 2 * TILE)] += weight * g_b
                lanes[_U(x + 3 * TILE)] += weight
                lanes[_U(x + 4 * TILE)] += by_power
                lanes[_U(x + 5 * TILE)] += by_power * dy
                lanes[_U(x + 6 * TILE)] += by_power * (dy * dy)
        s_r, s_g, s_b, s_w = _F(0.0), _F(0.0), _F(0.0), _F(0.0)
        s_p, s_x, s_y = _F(0.0), _F(0.0), _F(0.0)
        s_xx, s_xy, s_yy = _F(0.0), _F(0.0), _F(0.0)
        for x in range(TILE):
            dx = base + _F(x)
            s_r += lanes[_U(x)]
            s_g += lanes[_U(x + TILE)]
            s_b += lanes[_U(x + 2 * TILE)]
            s_w += lanes[_U(x + 3 * TILE)]
            by_power, by_y = lanes[_U(x + 4 * TILE)], lanes[_U(x + 5 * TILE)]
            s_p += by_power
            s_x += by_power * dx
            s_xx += by_power * dx * dx
            s_y += by_y
            s_xy += by_y * dx
            s_yy += lanes[_U(x + 6 * TILE)]
        out = gradient[i]
        out[MEAN_X] += a * s_x + b * s_y
        out[MEAN_Y] += b * s_x + c * s_y
        out[CONIC_A] += _F(-0.5) * s_xx
        out[CONIC_B] -= s_xy
        out[CONIC_C] += _F(-0.5) * s_yy
        out[ALPHA] += s_p / opacity
        out[RED] += s_r
        out[GREEN] += s_g
        out[BLUE] += s_b
        out[CONTRIBUTION] += s_w
