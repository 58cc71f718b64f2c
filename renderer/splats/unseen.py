"""Gives splats that no frame determines the colours of those around them.

They stay marked: sides of the body that no frame shows are filled in so, but parts that were never
filmed, as legs under a desk, would be invented, and fade out unless a viewer asks for them.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, OPACITY, POSITION
from scene.arrays import Array, Bool, Float

_NEIGHBOURS = 8
_DETERMINED_PX = 0.1
"""Evidence at which a splat's own colour weighs as much as one neighbour's."""
_TO_THE_MEAN = 1e-6
"""Weight of the mean colour: splats with no way to a determined one need some colour."""
_OPAQUE_WITHIN_M, _TRANSPARENT_FROM_M = 0.22, 0.42
"""Distance at rest from the nearest seen splat up to which an unseen one keeps its opacity, and
from which it is transparent. The back of a trunk lies up to 0.2 m from the sides that a camera in
front of it shows."""


def fill_unseen(
    parameters: Float[Array, "N P"], evidence: Float[Array, "N"]
) -> Float[Array, "N P"]:
    """`parameters` with the smoothest colours that agree with what frames determine.

    Colours minimise the squared differences between neighbours at rest plus, weighted by the
    square of the evidence, those from the trained ones (membrane interpolation, Terzopoulos 1986):
    detail that frames show stays, and the far side fades from rim to rim. Shape and opacity stay:
    training has made obstructing ones transparent.

    Args:
        evidence: pixels that show each splat, times the share of its light that reaches them.
    """
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    if not evidence.any():
        return parameters
    colours = parameters[:, COLOUR : COLOUR + 3].astype(np.float64)
    weights = (evidence.astype(np.float64) / _DETERMINED_PX) ** 2
    mean = np.average(colours, axis=0, weights=weights)
    edges = _neighbours(parameters[:, POSITION : POSITION + 3])
    diagonal = np.asarray(edges.sum(axis=1)).ravel() + weights + _TO_THE_MEAN
    # a sparse direct solver: far from all evidence, conjugate gradients take thousands of steps
    factors = splu(
        (diags(diagonal) - edges).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        options={"SymmetricMode": True},
    )
    filled = parameters.copy()
    filled[:, COLOUR : COLOUR + 3] = factors.solve(weights[:, None] * colours + _TO_THE_MEAN * mean)
    return filled


def _neighbours(rest: Float[Array, "N 3"]):
    """Symmetric adjacency, 1 where either is among the nearest of the other (scipy's CSR)."""
    from scipy.sparse import csr_matrix
    from scipy.spatial import KDTree

    count, size = min(_NEIGHBOURS, len(rest) - 1), len(rest)
    _, near = KDTree(rest).query(rest, k=count + 1)
    others = np.asarray(near)[:, 1:].ravel()
    pairs = (np.ones(len(others)), (np.repeat(np.arange(size), count), others))
    edges = csr_matrix(pairs, shape=(size, size))
    return edges.maximum(edges.T)


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
