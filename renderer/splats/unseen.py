"""Fades parts of the body that were never filmed, as legs under a desk: they would be invented.

Sides that no frame shows of parts that were filmed stay; `training.filling` guesses their colours.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import OPACITY, POSITION
from scene.arrays import Array, Bool, Float

_OPAQUE_WITHIN_M, _TRANSPARENT_FROM_M = 0.22, 0.42
"""Distance at rest from the nearest seen splat up to which an unseen one keeps its opacity, and
from which it is transparent. The back of a trunk lies up to 0.2 m from the sides that a camera in
front of it shows."""


def fade_unseen(parameters: Float[Array, "N P"], seen: Bool[Array, "N"]) -> Float[Array, "N P"]:
    """`parameters` with the parts of the body that were never filmed faded out."""
    result = parameters.copy()
    rest = parameters[:, POSITION : POSITION + 3]
    result[:, OPACITY] = _scale_opacity(result[:, OPACITY], capture_weight(rest, seen))
    return result


def capture_weight(rest: Float[Array, "N 3"], seen: Bool[Array, "N"]) -> Float[Array, "N"]:
    """Factor of opacity: 1 where the person was filmed or next to it, falling smoothly to 0.

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
