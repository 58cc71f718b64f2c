"""Splats moved at rest by what a face and hands do.

Letters: M splats that expressions move, S blend shapes, C models.
"""

from __future__ import annotations

import numba

from renderer.splats.layout import HIDDEN_LOGIT, OPACITY, POSITION
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
        if parameters[splats[m], OPACITY] <= HIDDEN_LOGIT:
            continue
        x, y, z = rest[m, 0], rest[m, 1], rest[m, 2]
        for s in range(shown.shape[1]):
            weight = shown[owner[m], s]
            if weight == 0.0:
                continue
            x += weight * offsets[m, s, 0]
            y += weight * offsets[m, s, 1]
            z += weight * offsets[m, s, 2]
        parameters[splats[m], POSITION] = x
        parameters[splats[m], POSITION + 1] = y
        parameters[splats[m], POSITION + 2] = z
