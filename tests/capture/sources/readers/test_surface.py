"""A surface made for joints alone lies where the true one does, though nobody knows it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from capture.sources.readers.surface import with_surface
from capture.studio.performer import make_performer
from scene import Body, Skeleton
from tests.capture.sequences import surface


def distance_m(body: Body, truth: Body) -> float:
    """Mean distance of the surface to the true one's vertices."""
    return float(KDTree(surface(truth)[0]).query(surface(body)[0])[0].mean())


@pytest.mark.parametrize("seed", range(4))
def test_the_surface_of_a_performer_is_found_from_their_joints(seed):
    truth = make_performer(seed).body
    body = with_surface(truth.skeleton)
    assert body.skeleton is truth.skeleton
    assert distance_m(body, truth) < 0.012


def test_bones_of_other_proportions_are_followed():
    """Longer legs than any shape has: the skin goes with them."""
    truth = make_performer(0).body
    sides = np.array([1.0, 1.1, 1.0])
    vertices, faces, weights = surface(truth)
    stretched = Body(Skeleton(truth.skeleton.rest_joints * sides), vertices * sides, faces, weights)
    assert distance_m(with_surface(stretched.skeleton), stretched) < 0.02
    assert distance_m(truth, stretched) > 0.04
