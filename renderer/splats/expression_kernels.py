"""Splats moved at rest by what a face and hands do.

Letters: M splats that expressions move, S blend shapes, C models.
"""

from __future__ import annotations

import numba

from renderer.splats.layout import POSITION
from scene.arrays import Array


@numba.njit(nogil=True, cache=True)
def apply_blend_shapes(
    parameters: Array,  # [N P] float32, positions of the M changed
    splats: Array,  # [M] int32
    owner: Array,  # [M] int32: index of the model
    rest: Array,  # [M 3] float32: positions where nothing is shown, m
    offsets: Array,  # [M S 3] float32, m
    shown: Array,  # [C S] float32: their weights
) -> None:
    """Rest positions plus the sum of each weight times its offset."""
    for m in range(splats.shape[0]):
        for x in range(3):
            place = rest[m, x]
            for s in range(shown.shape[1]):
                place += shown[owner[m], s] * offsets[m, s, x]
            parameters[splats[m], POSITION + x] = place
