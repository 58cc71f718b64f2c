"""A surface made for joints alone lies where the true one does, though nobody knows it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from capture.sources.readers.surface import with_surface
from capture.studio.performer import make_performer
from scene import Body, Skeleton
from scene.skeleton import JOINT_NAMES
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


def test_joints_that_another_body_model_puts_elsewhere_leave_the_skin_where_it_is():
    """SMPL's hips and head are lower in the same body than ours, its spine higher, its pelvis
    further in front: no reason to move the skin, but it turns about them."""
    truth = make_performer(1).body
    joints = truth.skeleton.rest_joints.copy()
    for name, offset in {
        "pelvis": (0.0, 0.0, 0.045),
        "left_hip": (-0.03, -0.08, 0.045),
        "right_hip": (0.03, -0.08, 0.045),
        "spine1": (0.0, 0.035, 0.06),
        "spine2": (0.0, 0.105, 0.045),
        "spine3": (0.0, 0.075, 0.06),
        "left_collar": (0.055, -0.045, 0.01),
        "right_collar": (-0.055, -0.045, 0.01),
        "head": (0.0, -0.05, 0.03),
    }.items():
        joints[JOINT_NAMES.index(name)] += offset
    joints -= joints[0] * [1.0, 0.0, 1.0]
    here = joints[JOINT_NAMES.index("neck")] - truth.skeleton.rest_joints[JOINT_NAMES.index("neck")]
    body = with_surface(Skeleton(joints))
    vertices, _, weights = surface(body)
    true_vertices, faces, true_weights = surface(truth)
    moved = Body(body.skeleton, true_vertices + here, faces, true_weights)
    assert distance_m(body, moved) < 0.012
    assert np.allclose(weights.sum(axis=1), 1.0)
    for name in ("spine1", "spine2", "spine3"):
        joint = JOINT_NAMES.index(name)
        share = weights[:, joint]
        middle = (share @ vertices[:, 1]) / share.sum()
        theirs = true_weights[:, joint]
        usual = (theirs @ true_vertices[:, 1]) / theirs.sum()
        raised = joints[joint, 1] - truth.skeleton.rest_joints[joint, 1]
        assert middle - usual > 0.4 * raised
