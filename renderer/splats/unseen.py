"""Splats that no frame showed take the colour of their mirror image, else of the nearest seen."""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, POSITION
from scene.arrays import Array, Bool, Float

_MIRROR_REACH_M = 0.03
"""How far from its mirror image a seen splat may be to stand for it."""
_ROWS = 1024
"""Distances are taken in blocks of so many rows, to bound memory."""


def fill_unseen(parameters: Float[Array, "N P"], seen: Bool[Array, "N"]) -> Float[Array, "N P"]:
    """Parameters with the colour of every unseen splat borrowed from a seen one.

    Their shape and opacity stay: training has made those transparent that stood in its way.
    """
    if seen.all() or not seen.any():
        return parameters
    filled = parameters.copy()
    missing, known = np.flatnonzero(~seen), np.flatnonzero(seen)
    rest, colours = parameters[:, POSITION : POSITION + 3], slice(COLOUR, COLOUR + 3)
    mirrored = rest[missing] * np.array([-1.0, 1.0, 1.0], np.float32)
    mirror_distance, mirror = _nearest(mirrored, rest[known])
    _, nearest = _nearest(rest[missing], rest[known])
    donor = known[np.where(mirror_distance < _MIRROR_REACH_M, mirror, nearest)]
    filled[missing, colours] = parameters[donor, colours]
    return filled


def _nearest(points: Array, others: Array) -> tuple[Float[Array, "M"], Array]:
    """Distance to, and index of, the nearest of `others` for each of `points`."""
    distance, index = np.empty(len(points)), np.empty(len(points), np.int64)
    squares = (others**2).sum(axis=1)
    for start in range(0, len(points), _ROWS):
        block = points[start : start + _ROWS]
        gaps = (block**2).sum(axis=1)[:, None] - 2.0 * block @ others.T + squares
        best = gaps.argmin(axis=1)
        index[start : start + _ROWS] = best
        distance[start : start + _ROWS] = np.sqrt(
            np.maximum(gaps[np.arange(len(block)), best], 0.0)
        )
    return distance, index
