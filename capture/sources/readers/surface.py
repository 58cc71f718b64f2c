"""A surface for joints that came without one: MetaNeRF's body model, fitted to them.

SMPL's surface may not be redistributed. The body model's, of the shape with the nearest joints and
with every bone moved to its joint, is off by a centimetre or two: a good initial surface.
"""

from __future__ import annotations

import numpy as np

from capture.body.model import load_body_model
from scene.body import Body
from scene.skeleton import Skeleton

_SHAPE_WEIGHT = 0.03
"""Regularisation of the shape numbers to the mean, m: joints hardly determine them."""


def with_surface(skeleton: Skeleton) -> Body:
    """The body of `skeleton`, with a rest surface and blend weights."""
    model = load_body_model()
    target = (skeleton.rest_joints - skeleton.rest_joints[0]).ravel()
    # scale * (mean + directions @ shape) is linear in scale and in scale * shape
    mean = (model.rest_joints - model.rest_joints[0]).reshape(-1, 1)
    directions = (model.joint_directions - model.joint_directions[0]).reshape(len(mean), -1)
    design = np.concatenate([directions, mean], axis=1)
    regulariser = np.diag([_SHAPE_WEIGHT] * model.shape_count + [0.0])
    solution = np.linalg.lstsq(
        np.concatenate([design, regulariser]),
        np.concatenate([target, np.zeros(len(regulariser))]),
        rcond=None,
    )[0]
    scale = float(
        np.clip(solution[-1], 0.3, 3.0)
    )  # implausible joints still get a plausible surface
    body = model.body(solution[:-1] / scale, scale)
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    offsets = skeleton.rest_joints - body.skeleton.rest_joints
    vertices = body.rest_vertices + body.blend_weights @ offsets
    return Body(skeleton, vertices, body.faces, body.blend_weights)
