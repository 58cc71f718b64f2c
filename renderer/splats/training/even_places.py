"""Picks places on a surface that lie evenly: blue noise, by sample elimination.

Draws by chance lie in clumps, with gaps between them that a splat has to be wide to close. Of
several times as many, the most crowded is left out again and again (Yuksel, Sample Elimination for
Generating Poisson Disk Sample Sets, 2015).
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float, Int

_NEAREST = 24
"""Neighbours that a place looks at: of three or four times as many places as are kept, hardly more
lie within reach."""
_COUNTED = 6
"""Neighbours by which the places' density is found."""
_REACH = 2.0 / 12.0**0.25
"""Distance from which two places don't crowd each other, as a share of the spacing: that of the
densest packing, hexagonal."""
_POWER = 8
"""Yuksel's alpha: near ones crowd each other far more."""
_SAME_SIDE = 0.3
"""Cosine of two normals above which places are neighbours: both sides of an ear lie close."""


def even_places(
    points: Float[Array, "M 3"],
    normals: Float[Array, "M 3"],
    spacing: Float[Array, "M"],
    count: int,
) -> Int[Array, "N"]:
    """Which `count` of the `points` lie evenly; in their order.

    Args:
        normals: unit length.
        spacing: that is wanted between neighbours, up to a factor.
    """
    from scipy.sparse import csr_matrix
    from scipy.spatial import KDTree

    from renderer.splats.training.even_places_kernels import eliminate

    size = len(points)
    if count >= size:
        return np.arange(size)
    nearest = min(_NEAREST, size - 1)
    found = KDTree(points).query(points, k=nearest + 1, workers=-1)
    apart, near = (np.asarray(values)[:, 1:] for values in found)
    kept_spacing = spacing * _factor(apart, spacing) * np.sqrt(size / count)
    first, second = np.repeat(np.arange(size), nearest), near.ravel()
    reach = 0.5 * _REACH * (kept_spacing[first] + kept_spacing[second])
    crowding = np.maximum(1.0 - apart.ravel() / reach, 0.0) ** _POWER
    crowding[np.einsum("ex,ex->e", normals[first], normals[second]) < _SAME_SIDE] = 0.0
    edges = csr_matrix((crowding, (first, second)), shape=(size, size))
    edges = edges.maximum(edges.T).tocsr()
    edges.eliminate_zeros()
    crowded = np.asarray(edges.sum(axis=1)).ravel()
    return np.flatnonzero(eliminate(edges.indptr, edges.indices, edges.data, crowded, count))


def _factor(apart: Float[Array, "M K"], spacing: Float[Array, "M"]) -> float:
    """How many times `spacing` the places' own is."""
    counted = min(_COUNTED, apart.shape[1])
    own = apart[:, counted - 1] * np.sqrt(np.pi / (counted + 0.5))
    return float(np.median(own / spacing))
