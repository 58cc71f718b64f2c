"""Places that lie evenly on a surface."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from renderer.splats.training.even_places import even_places

UP = np.array([0.0, 0.0, 1.0])


def sheet(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points by chance on the unit square."""
    return np.column_stack([rng.uniform(size=(count, 2)), np.zeros(count)])


def kept(points: np.ndarray, count: int, spacing: np.ndarray | float = 1.0) -> np.ndarray:
    return even_places(
        points,
        np.broadcast_to(UP, points.shape),
        np.broadcast_to(spacing, len(points)).astype(float),
        count,
    )


def nearest(points: np.ndarray) -> np.ndarray:
    """Distance of each point to the next."""
    apart, _ = KDTree(points).query(points, k=2)
    return np.asarray(apart)[:, 1]


def test_no_two_lie_close():
    rng = np.random.default_rng(0)
    points = sheet(6000, rng)
    even, by_chance = points[kept(points, 2000)], points[:2000]
    spacing = 2000.0**-0.5
    assert np.percentile(nearest(even), 2) > 0.6 * spacing
    assert np.percentile(nearest(by_chance), 2) < 0.2 * spacing
    # nor is a hole left anywhere: from any place, one is near
    asked = 0.1 + 0.8 * sheet(4000, rng)
    asked[:, 2] = 0.0
    farthest = [np.max(KDTree(some).query(asked)[0]) for some in (even, by_chance)]
    assert farthest[0] < 1.3 * spacing < farthest[1]


def test_they_are_as_dense_as_wanted():
    rng = np.random.default_rng(1)
    points = sheet(9000, rng)
    # candidates are as dense as places are to be
    points = points[(points[:, 0] < 0.5) | (rng.uniform(size=9000) < 0.25)]
    right = points[:, 0] >= 0.5
    chosen = kept(points, len(points) // 3, np.where(right, 2.0, 1.0))
    assert 0.22 < right[chosen].sum() / (~right[chosen]).sum() < 0.28
    spacing = np.median(nearest(points[chosen][right[chosen]]))
    assert 1.8 < spacing / np.median(nearest(points[chosen][~right[chosen]])) < 2.2


def test_the_other_side_of_an_ear_is_no_neighbour():
    rng = np.random.default_rng(2)
    front, back = sheet(3000, rng), sheet(3000, rng) - 1e-4 * UP
    points = np.concatenate([front, back])
    normals = np.concatenate([np.broadcast_to(UP, front.shape), np.broadcast_to(-UP, back.shape)])
    chosen = even_places(points, normals, np.ones(6000), 2000)
    one_side = points[chosen[chosen < 3000]]
    assert 950 < len(one_side) < 1050
    alone = front[kept(front, len(one_side))]
    assert np.median(nearest(one_side)) > 0.95 * np.median(nearest(alone))


@settings(deadline=None, max_examples=30)
@given(size=st.integers(1, 60), count=st.integers(1, 80), seed=st.integers(0, 9))
def test_as_many_as_asked_for_in_their_order(size, count, seed):
    points = sheet(size, np.random.default_rng(seed))
    points[: size // 3] = points[0]
    chosen = kept(points, count)
    assert len(chosen) == min(size, count)
    assert (np.diff(chosen) > 0).all()
    np.testing.assert_array_equal(chosen, kept(points, count))
