"""Compiled energy of optical flow, with its gradient."""

from __future__ import annotations

import numba

from scene.arrays import Array


@numba.njit(cache=True, nogil=True)
def motion_energy(
    pixels: Array,
    stride: int,
    displacements: Array,
    valid: Array,
    certainty: Array,
    deviation: Array,
    outlier: float,
    few: float,
    by_pixel: Array,
) -> float:
    """Mean over pairs of `pixels` [F V 2] that are `stride` frames apart: robust error of how they
    moved against `displacements` [pairs V 2], in units of `deviation` [F], where `valid` [pairs V],
    weighted by `certainty` [pairs V 3] (xx, xy, yy). A pair of only `few` vertices has half its
    weight. Adds the gradient to `by_pixel` [F V 2].
    """
    pairs, total = len(displacements), 0.0
    for f in range(pairs):
        here, there, unit = pixels[f], pixels[f + stride], 1.0 / float(deviation[f])
        count, energy = 0.0, 0.0
        for v in range(pixels.shape[1]):
            count += valid[f, v]
        share = 1.0 / ((count + few) * pairs)
        for v in range(pixels.shape[1]):
            if valid[f, v] == 0.0:
                continue
            x = (there[v, 0] - here[v, 0] - displacements[f, v, 0]) * unit
            y = (there[v, 1] - here[v, 1] - displacements[f, v, 1]) * unit
            xx, xy, yy = certainty[f, v, 0], certainty[f, v, 1], certainty[f, v, 2]
            along, down = xx * x + xy * y, xy * x + yy * y
            squared = along * x + down * y
            kept = 1.0 / (1.0 + squared / (outlier * outlier))
            energy += squared * kept
            pull = 2.0 * kept * kept * share * unit
            by_pixel[f, v, 0] -= pull * along
            by_pixel[f, v, 1] -= pull * down
            by_pixel[f + stride, v, 0] += pull * along
            by_pixel[f + stride, v, 1] += pull * down
        total += energy * share
    return total


@numba.njit(cache=True, nogil=True)
def nearest_motion(
    start: Array, end: Array, visible: Array, cell: int, farthest: float, motion: Array
) -> None:
    """In the middle of each cell [h w], `cell` px a side: how the nearest of the `visible` [V]
    vertices moves from `start` to `end` [V 2], px; nought where none is within `farthest`."""
    for row in range(motion.shape[0]):
        y = row * cell + cell // 2
        for column in range(motion.shape[1]):
            x, nearest, found = column * cell + cell // 2, farthest * farthest, -1
            for v in range(len(visible)):
                if visible[v]:
                    away = (start[v, 0] - x) ** 2 + (start[v, 1] - y) ** 2
                    if away <= nearest:
                        nearest, found = away, v
            for c in range(2):
                motion[row, column, c] = end[found, c] - start[found, c] if found >= 0 else 0.0
