"""On which kind of surface splats lie."""

from __future__ import annotations

import numpy as np

from capture.body.model import load_body_model
from renderer.splats.training.surface_kinds import KINDS, surface_kinds
from scene.arrays import Array, Bool, Float
from scene.skeleton import HEAD, JOINT_NAMES


def kinds_of_the_body(scale: float = 1.0) -> tuple[Float[Array, "V 3"], Array]:
    """Vertices of the mean body from its head's joint, in shares of its head's height above that,
    and the kind of each."""
    body = load_body_model().body(np.zeros(5), scale)
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    joints = np.argsort(-body.blend_weights, axis=1)[:, :4]
    weights = np.take_along_axis(body.blend_weights, joints, axis=1)
    kinds = surface_kinds(body.rest_vertices, joints, weights, body.skeleton)
    at = body.rest_vertices - body.skeleton.rest_joints[HEAD]
    return at / at[:, 1].max(), kinds


def moved_by(part: str) -> Bool[Array, "V"]:
    body = load_body_model()
    return np.array([part in JOINT_NAMES[k] for k in body.blend_weights.argmax(axis=1)])


def test_the_back_of_the_head_is_scalp_and_the_face_is_not():
    at, kinds = kinds_of_the_body()
    scalp, head = kinds == KINDS.index("scalp"), moved_by("head")
    back = head & (at[:, 2] < -0.3) & (at[:, 1] > -0.2)
    assert back.sum() > 50
    assert scalp[back].all()
    assert scalp[head & (at[:, 1] > 0.9)].all()
    moved = load_body_model().expression_directions
    assert moved is not None
    mouth = np.linalg.norm(moved[0], axis=1) > 0.005
    assert mouth.sum() > 100
    assert not scalp[mouth].any()
    assert not scalp[at[:, 1] < -0.5].any()  # nor the neck, but for the nape


def test_parts_follow_the_joints_that_move_them():
    _, kinds = kinds_of_the_body()
    for part, kind in (("wrist", "hands"), ("elbow", "arms"), ("knee", "legs"), ("spine", "trunk")):
        assert (kinds[moved_by(part)] == KINDS.index(kind)).all()


def test_a_smaller_body_has_the_same_kinds():
    np.testing.assert_array_equal(kinds_of_the_body()[1], kinds_of_the_body(0.6)[1])
