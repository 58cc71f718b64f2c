"""A surface for joints that came without one: MetaNeRF's body model, fitted to them.

SMPL's surface may not be redistributed. Where joints are in a body is each body model's own choice:
SMPL's spine, hips and head are 5 to 12 cm away from ours in the same person, while knees, ankles,
shoulders, elbows and wrists are the same places. Shape, size and place of the surface are found by
these alone, and the others only say about which points the skin turns. The surface is off by a
centimetre or two: a good initial one.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from capture.body.model import LinearBodyModel, load_body_model
from scene.arrays import Array, Float
from scene.body import Body
from scene.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton

_SHAPE_WEIGHT = 0.03
"""Regularisation of the shape numbers to the mean, m: joints hardly determine them."""
_SHARED = [
    JOINT_NAMES.index(f"{side}_{name}")
    for name in ("knee", "ankle", "shoulder", "elbow", "wrist")
    for side in ("left", "right")
]
"""Joints that every body model has in the same place of the body."""
_NEIGHBOURS = 4
"""Points of the skin from which blend weights are interpolated."""


def with_surface(skeleton: Skeleton) -> Body:
    """The body of `skeleton`, with a rest surface and blend weights."""
    model = load_body_model()
    body, place = _fitted(model, skeleton)
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    offsets = skeleton.rest_joints - body.skeleton.rest_joints - place
    vertices = body.rest_vertices + place + body.blend_weights @ _of_the_skin(offsets, body)
    # where the skin of a body would be whose joints are all as they are here
    carrier = body.rest_vertices + place + body.blend_weights @ offsets
    return Body(skeleton, vertices, body.faces, _weights(vertices, carrier, body.blend_weights))


def _fitted(model: LinearBodyModel, skeleton: Skeleton) -> tuple[Body, Float[Array, "3"]]:
    """The body whose `_SHARED` joints are nearest, and how far it is to be moved."""
    # scale * (mean + directions @ shape) + place is linear in scale, scale * shape and place
    mean = model.rest_joints[_SHARED].reshape(-1, 1)
    directions = model.joint_directions[_SHARED].reshape(len(mean), -1)
    places = np.tile(np.eye(3), (len(_SHARED), 1))
    design = np.concatenate([directions, mean, places], axis=1)
    regulariser = np.diag([_SHAPE_WEIGHT] * model.shape_count + [0.0] * 4)
    solution = np.linalg.lstsq(
        np.concatenate([design, regulariser]),
        np.concatenate([skeleton.rest_joints[_SHARED].ravel(), np.zeros(len(regulariser))]),
        rcond=None,
    )[0]
    shape, scale = solution[: model.shape_count], solution[model.shape_count]
    # implausible joints still get a plausible surface
    scale = float(np.clip(scale, 0.3, 3.0))
    body = model.body(shape / scale, scale)
    off = skeleton.rest_joints[_SHARED] - body.skeleton.rest_joints[_SHARED]
    return body, off.mean(axis=0)


def _of_the_skin(offsets: Float[Array, "K 3"], body: Body) -> Float[Array, "K 3"]:
    """`offsets` at the `_SHARED` joints; those between follow them, by their height."""
    height = body.skeleton.rest_joints[:, 1]
    moved = np.zeros_like(offsets)
    middle = {
        name: [JOINT_NAMES.index(f"{side}_{name}") for side in ("left", "right")]
        for name in ("knee", "shoulder")
    }
    known = [height[middle["knee"]].mean(), height[middle["shoulder"]].mean()]
    ends = [offsets[middle["knee"]].mean(axis=0), offsets[middle["shoulder"]].mean(axis=0)]
    for joint in range(JOINT_COUNT):
        if joint in _SHARED:
            moved[joint] = offsets[joint]
        elif PARENTS[joint] in _SHARED:  # hands and feet
            moved[joint] = moved[PARENTS[joint]]
        else:
            moved[joint] = [
                np.interp(height[joint], known, axis) for axis in zip(*ends, strict=True)
            ]
    return moved


def _weights(
    vertices: Float[Array, "V 3"], carrier: Float[Array, "V 3"], weights: Float[Array, "V K"]
) -> Float[Array, "V K"]:
    """`weights` of the points of `carrier`, at `vertices`."""
    distance, near = KDTree(carrier).query(vertices, k=_NEIGHBOURS)
    nearness = 1.0 / (distance + 1e-4)
    shares = nearness / nearness.sum(axis=1, keepdims=True)
    return np.einsum("vn,vnk->vk", shares, weights[near])
