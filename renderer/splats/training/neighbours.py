"""Which splats lie beside which at rest."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float

_NEIGHBOURS = 8


def neighbours_at_rest(rest: Float[Array, "N 3"]):
    """Symmetric adjacency [N N], 1 where either is among the eight nearest of the other (scipy's
    CSR)."""
    from scipy.sparse import csr_matrix
    from scipy.spatial import KDTree

    count, size = min(_NEIGHBOURS, len(rest) - 1), len(rest)
    _, near = KDTree(rest).query(rest, k=count + 1)
    others = np.asarray(near)[:, 1:].ravel()
    pairs = (np.ones(len(others)), (np.repeat(np.arange(size), count), others))
    edges = csr_matrix(pairs, shape=(size, size))
    return edges.maximum(edges.T)


def mean_of_neighbours(rest: Float[Array, "N 3"]):
    """[N N]: times what splats have, the mean of it beside each (scipy's CSR)."""
    edges = neighbours_at_rest(rest)
    return edges.multiply(1.0 / edges.sum(axis=1)).tocsr()
