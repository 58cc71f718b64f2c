"""Splats that no frame showed take the colour of their mirror image, else of the nearest seen.

They stay marked, so that a viewer may ask for what was captured alone.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION
from scene.arrays import Array, Bool, Float

_MIRROR_REACH_M = 0.03
"""How far from its mirror image a seen splat may be to stand for it."""
_ROUND_M = 0.04
"""Colours are borrowed from all that is seen within this: a single splat may be far off."""
_KEPT_M, _GONE_M = 0.02, 0.1
"""Distance at rest from the nearest seen splat up to which an unseen one is whole, and from which
it is gone: single ones among seen ones leave no hole, and an edge fades over a hand's breadth."""
_WIDER = 0.3
"""Added to the logarithm of the sizes."""


def fill_unseen(parameters: Float[Array, "N P"], seen: Bool[Array, "N"]) -> Float[Array, "N P"]:
    """Parameters with the colour of every unseen splat borrowed from a seen one.

    Their shape and opacity stay: training has made those transparent that stood in its way.
    """
    from scipy.spatial import KDTree

    if seen.all() or not seen.any():
        return parameters
    filled = parameters.copy()
    missing, known = np.flatnonzero(~seen), np.flatnonzero(seen)
    rest, colours = parameters[:, POSITION : POSITION + 3], slice(COLOUR, COLOUR + 3)
    mirrored = rest[missing] * np.array([-1.0, 1.0, 1.0], np.float32)
    tree = KDTree(rest[known])
    mirror_distance, mirror = tree.query(mirrored)
    _, nearest = tree.query(rest[missing])
    donor = known[np.where(mirror_distance < _MIRROR_REACH_M, mirror, nearest)]
    givers, place = np.unique(donor, return_inverse=True)
    filled[missing, colours] = _mean_colours_around(
        rest[givers], rest[known], parameters[known, colours]
    )[place]
    return filled


def _mean_colours_around(
    points: Float[Array, "M 3"], others: Float[Array, "K 3"], colours: Float[Array, "K 3"]
) -> Float[Array, "M 3"]:
    """Mean colour of the `others` round each of `points`, which is one of them."""
    from scipy.spatial import KDTree

    mean = np.empty_like(colours, shape=(len(points), 3))
    for index, near in enumerate(KDTree(others).query_ball_point(points, _ROUND_M)):
        mean[index] = colours[near].mean(axis=0)
    return mean


def faded(parameters: Float[Array, "N P"], seen: Bool[Array, "N"]) -> Float[Array, "N P"]:
    """`parameters` with what no frame showed faded away."""
    result = parameters.copy()
    # the far side, which closed what gaps there are between splats, is gone
    result[:, LOG_SCALE : LOG_SCALE + 3] += _WIDER
    rest = parameters[:, POSITION : POSITION + 3]
    result[:, OPACITY] = _faded_logits(result[:, OPACITY], presence(rest, seen))
    return result


def presence(rest: Float[Array, "N 3"], seen: Bool[Array, "N"]) -> Float[Array, "N"]:
    """1 where the person was captured, falling smoothly to 0 where they were not.

    `rest` are the splats' positions at rest, m.
    """
    from scipy.spatial import KDTree

    present = np.where(seen, 1.0, 0.0)
    if seen.any():
        missing = np.flatnonzero(~seen)
        distance, _ = KDTree(rest[seen]).query(rest[missing])
        near = np.clip((_GONE_M - distance) / (_GONE_M - _KEPT_M), 0.0, 1.0)
        present[missing] = near**2 * (3.0 - 2.0 * near)
    return present


def _faded_logits(logits: Float[Array, "N"], presence: Float[Array, "N"]) -> Float[Array, "N"]:
    """Logits of the opacities times `presence`."""
    opacity = np.clip(presence / (1.0 + np.exp(-logits.astype(np.float64))), 1e-9, 1.0 - 1e-9)
    return np.log(opacity / (1.0 - opacity)).astype(logits.dtype)
