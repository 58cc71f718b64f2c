"""What is known of a body before any picture: weights and distance on a grid."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.field.skinning.rest_shape import RestShape, rest_shape
from scene import JOINT_NAMES, Body
from tests.renderer.field.performer import body

VOLUME = (24, 72, 72)


def _at(shape: RestShape, point: np.ndarray) -> tuple[int, int, int]:
    size = np.array(VOLUME[::-1]) - 1
    x, y, z = np.rint((point - shape.low) / (shape.high - shape.low) * size).astype(int)
    return int(z), int(y), int(x)


@pytest.fixture(scope="module", params=["surface", "joints"])
def shape(request) -> RestShape:
    person = body() if request.param == "surface" else Body(body().skeleton)
    return rest_shape(person, VOLUME, 0.04)


def test_prior_is_a_probability(shape):
    assert shape.prior.shape == (25, *VOLUME)
    assert (shape.prior >= 0.0).all()
    assert np.abs(shape.prior.sum(axis=0) - 1.0).max() < 0.06  # each channel is rounded to bytes


def test_the_border_is_background(shape):
    for axis in (1, 2, 3):
        for end in (0, -1):
            assert np.take(shape.prior, end, axis)[-1].min() > 0.99


def test_inside_is_negative_outside_positive(shape):
    joints = body().skeleton.rest_joints
    for name in ("spine2", "left_knee", "right_elbow", "head"):
        assert shape.signed_distance[_at(shape, joints[JOINT_NAMES.index(name)])] < 0.0
    beyond = joints[JOINT_NAMES.index("left_hand")] + [0.16, 0.0, 0.0]
    assert shape.signed_distance[_at(shape, beyond)] > 0.0
    assert shape.signed_distance[_at(shape, shape.low)] > 0.0
    between_legs = 0.5 * (joints[4] + joints[5])
    assert shape.signed_distance[_at(shape, between_legs)] > 0.0


def test_limbs_follow_their_own_joint(shape):
    joints = body().skeleton.rest_joints
    for parent, child in (("left_knee", "left_ankle"), ("right_shoulder", "right_elbow")):
        owner = JOINT_NAMES.index(parent)
        middle = 0.5 * (joints[owner] + joints[JOINT_NAMES.index(child)])
        assert shape.prior[:, *_at(shape, middle)].argmax() == owner
