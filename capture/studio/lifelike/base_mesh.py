"""MakeHuman's base mesh hm08 in a person's shape: our body's vertices and the helpers around them.

`assets/base_mesh.npz` is made by `python -m tools.build_base_mesh` (see there).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.body.model import load_body_model
from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.expression import BLEND_SHAPE_COUNT, offsets_of_any_version

ASSET = Path(__file__).parents[2] / "assets" / "base_mesh.npz"


@dataclass(frozen=True, eq=False)
class BaseMesh:
    """All H vertices that garments may be tied to, as one person has them at rest."""

    rest_vertices: Float[Array, "H 3"]
    """T-pose, m, on the same floor as the person's body."""
    blend_weights: Float[Array, "H 24"]
    expression_directions: Float[Array, "S H 3"]
    to_t_pose: Float[Array, "H 3 3"]
    """Turns offsets, which are given in MakeHuman's rest pose, into the T-pose."""
    body_indices: Int[Array, "V"]
    """Where each vertex of the body is among these."""
    texture: Float[Array, "T 3 2"]
    """Of the corners of the body's triangles: right and up, 0 to 1."""


def base_mesh_of(shape: Float[Array, "5"], body: Body) -> BaseMesh:
    """The base mesh around `body`, which is the body model's of `shape`."""
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    mean = load_body_model()
    with np.load(ASSET) as stored:
        indices = stored["body_indices"].astype(np.int64)
        helper_vertices = stored["rest_vertices"] + stored["vertex_directions"] @ shape
        helper_expressions = offsets_of_any_version(
            stored["expression_directions"].astype(np.float64), axis=0
        )
        helper_weights = np.zeros((len(helper_vertices), body.blend_weights.shape[1]))
        np.put_along_axis(
            helper_weights, stored["weight_joints"].astype(np.int64), stored["weights"], axis=1
        )
        turns = stored["to_t_pose"].astype(np.float64)
        texture = stored["texture"][stored["face_texture"]].astype(np.float64)
    # the body stands on the floor, helpers with it
    floor = body.rest_vertices - (mean.rest_vertices + mean.vertex_directions @ shape)
    count = len(indices) + len(helper_vertices)
    helpers = np.setdiff1d(np.arange(count), indices)
    vertices, weights = np.empty((count, 3)), np.empty((count, body.blend_weights.shape[1]))
    expressions = np.zeros((BLEND_SHAPE_COUNT, count, 3))
    vertices[indices], vertices[helpers] = body.rest_vertices, helper_vertices + floor[0]
    weights[indices], weights[helpers] = body.blend_weights, helper_weights
    if body.expression_directions is not None:
        expressions[:, indices] = body.expression_directions
        expressions[:, helpers] = helper_expressions
    return BaseMesh(
        vertices,
        weights / weights.sum(axis=1, keepdims=True),
        expressions,
        np.tensordot(weights, turns, axes=1),
        indices,
        texture,
    )
