"""Fills unseen splats with the colour of their mirror image, else of the nearest seen splat.

They stay marked, so that a viewer can hide them.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION
from scene.arrays import Array, Bool, Float

_MIRROR_RADIUS_M = 0.03
"""Distance within which a seen splat counts as the mirror image."""
_COLOUR_RADIUS_M = 0.04
"""Colours are the mean of seen splats within this radius: single ones are noisy."""
_OPAQUE_WITHIN_M, _TRANSPARENT_FROM_M = 0.02, 0.1
"""Distance at rest from the nearest seen splat up to which an unseen one keeps its opacity, and
from which it is transparent: no holes among seen ones, and soft edges."""
_LOG_SCALE_GROWTH = 0.3
"""Added to the logarithm of the sizes."""


def fill_unseen(parameters: Float[Array, "N P"], seen: Bool[Array, "N"]) -> Float[Array, "N P"]:
    """Parameters with the colour of every unseen splat borrowed from a seen one.

    Their shape and opacity stay: training has made obstructing ones transparent.
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
    donor = known[np.where(mirror_distance < _MIRROR_RADIUS_M, mirror, nearest)]
    donors, place = np.unique(donor, return_inverse=True)
    filled[missing, colours] = _mean_colours_around(
        rest[donors], rest[known], parameters[known, colours]
    )[place]
    return filled


def _mean_colours_around(
    points: Float[Array, "M 3"], others: Float[Array, "K 3"], colours: Float[Array, "K 3"]
) -> Float[Array, "M 3"]:
    """Mean colour of the `others` round each of `points`, which is one of them."""
    from scipy.spatial import KDTree

    mean = np.empty_like(colours, shape=(len(points), 3))
    for index, near in enumerate(KDTree(others).query_ball_point(points, _COLOUR_RADIUS_M)):
        mean[index] = colours[near].mean(axis=0)
    return mean


def fade_unseen(parameters: Float[Array, "N P"], seen: Bool[Array, "N"]) -> Float[Array, "N P"]:
    """`parameters` with unseen splats faded out."""
    result = parameters.copy()
    # the far side no longer fills the gaps between splats
    result[:, LOG_SCALE : LOG_SCALE + 3] += _LOG_SCALE_GROWTH
    rest = parameters[:, POSITION : POSITION + 3]
    result[:, OPACITY] = _scale_opacity(result[:, OPACITY], capture_weight(rest, seen))
    return result


def capture_weight(rest: Float[Array, "N 3"], seen: Bool[Array, "N"]) -> Float[Array, "N"]:
    """Factor of opacity: 1 where the person was captured, falling smoothly to 0 elsewhere.

    `rest` are the splats' positions at rest, m.
    """
    from scipy.spatial import KDTree

    weight = np.where(seen, 1.0, 0.0)
    if seen.any():
        missing = np.flatnonzero(~seen)
        distance, _ = KDTree(rest[seen]).query(rest[missing])
        near = np.clip(
            (_TRANSPARENT_FROM_M - distance) / (_TRANSPARENT_FROM_M - _OPAQUE_WITHIN_M), 0.0, 1.0
        )
        weight[missing] = near**2 * (3.0 - 2.0 * near)
    return weight


def _scale_opacity(
    logits: Float[Array, "N"], capture_weight: Float[Array, "N"]
) -> Float[Array, "N"]:
    """Logits of the opacities times `capture_weight`."""
    opacity = np.clip(capture_weight / (1.0 + np.exp(-logits.astype(np.float64))), 1e-9, 1.0 - 1e-9)
    return np.log(opacity / (1.0 - opacity)).astype(logits.dtype)
