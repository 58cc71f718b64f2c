"""A surface for joints that came without one: our body model's, fitted to them.

A data set whose surface is SMPL's may not pass it on. Ours, of the shape whose joints are nearest
and with every bone moved to its place, is off by a centimetre or two: a far better start than none.
"""

from __future__ import annotations

import numpy as np

from capture.body.model import load_body_model
from scene.body import Body
from scene.skeleton import Skeleton

_SHAPE_WEIGHT = 0.03
"""Pull of the shape numbers to the mean, m: joints tell little about them."""


def with_surface(skeleton: Skeleton) -> Body:
    """The body of `skeleton`, with a rest surface and blend weights."""
    model = load_body_model()
    wanted = (skeleton.rest_joints - skeleton.rest_joints[0]).ravel()
    # scale * (mean + directions @ shape) is linear in scale and in scale * shape
    mean = (model.rest_joints - model.rest_joints[0]).reshape(-1, 1)
    directions = (model.joint_directions - model.joint_directions[0]).reshape(len(mean), -1)
    design = np.concatenate([directions, mean], axis=1)
    pull = np.diag([_SHAPE_WEIGHT] * model.shape_count + [0.0])
    solved = np.linalg.lstsq(
        np.concatenate([design, pull]), np.concatenate([wanted, np.zeros(len(pull))]), rcond=None
    )[0]
    scale = float(np.clip(solved[-1], 0.3, 3.0))  # joints of nobody still get somebody's surface
    body = model.body(solved[:-1] / scale, scale)
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    moved = skeleton.rest_joints - body.skeleton.rest_joints
    vertices = body.rest_vertices + body.blend_weights @ moved
    return Body(skeleton, vertices, body.faces, body.blend_weights)
