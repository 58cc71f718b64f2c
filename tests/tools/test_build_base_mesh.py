"""The base mesh's asset around the body's."""

from __future__ import annotations

import numpy as np

from capture.body.model import load_body_model
from capture.studio.lifelike.base_mesh import base_mesh_of

SHAPE = np.array([0.05, -0.1, 0.3, 0.1, 0.0])


def test_the_body_is_in_the_base_mesh_unchanged():
    body = load_body_model().body(SHAPE)
    assert body.faces is not None
    base = base_mesh_of(SHAPE, body)

    np.testing.assert_array_equal(base.rest_vertices[base.body_indices], body.rest_vertices)
    np.testing.assert_allclose(base.blend_weights.sum(axis=1), 1.0)
    assert base.texture.shape == (len(body.faces), 3, 2)


def test_helpers_lie_around_the_body_in_every_shape():
    """hm08's tights, 15328 to 17975, are a skin of their own just outside of the body."""
    for shape in (np.zeros(5), SHAPE):
        body = load_body_model().body(shape)
        assert body.rest_vertices is not None
        tights = base_mesh_of(shape, body).rest_vertices[15328:17976:25]
        between = np.linalg.norm(tights[:, None] - body.rest_vertices[None], axis=-1)
        assert between.min(axis=1).max() < 0.05


def test_arms_were_turned_into_the_t_pose_and_the_head_was_not():
    body = load_body_model().body(np.zeros(5))
    assert body.rest_vertices is not None
    base = base_mesh_of(np.zeros(5), body)
    wrist = base.body_indices[body.rest_vertices[:, 0].argmax()]
    crown = base.body_indices[body.rest_vertices[:, 1].argmax()]

    np.testing.assert_allclose(base.to_t_pose[crown], np.eye(3), atol=1e-6)
    # down and outwards as modelled; along x in the T-pose
    modelled = base.to_t_pose[wrist].T @ np.array([1.0, 0.0, 0.0])
    assert modelled[1] < -0.3
