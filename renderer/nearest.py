"""Which of many points is nearest, by brute force in bounded memory."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float

ROWS = 1024
"""Distances are taken in blocks of so many rows, to bound memory."""


def nearest_points(points: Array, others: Array) -> tuple[Float[Array, "M"], Array]:
    """Distance to, and index of, the nearest of `others` for each of `points`."""
    distance, index = np.empty(len(points)), np.empty(len(points), np.int64)
    for start in range(0, len(points), ROWS):
        gaps = squared_distances(points[start : start + ROWS], others)
        index[start : start + ROWS] = best = gaps.argmin(axis=1)
        distance[start : start + ROWS] = np.sqrt(gaps[np.arange(len(gaps)), best])
    return distance, index


def squared_distances(points: Array, others: Array) -> Float[Array, "M K"]:
    """Squared distances of each of `points` to each of `others`."""
    gaps = (points**2).sum(axis=1)[:, None] - 2.0 * points @ others.T + (others**2).sum(axis=1)
    return np.maximum(gaps, 0.0)
