"""Forward kinematics, linear blend skinning and projection in torch, batched over frames.

Everything is in OpenGL's camera frame: y up, z towards the viewer, the camera at the origin, so
that a person who faces the camera faces +z as at rest. F frames, 24 joints, V sampled vertices.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch

from scene.arrays import Float, Int, Tensor
from scene.skeleton import JOINT_COUNT, PARENTS


class PosedBody(NamedTuple):
    """A skeleton posed in every frame, and the shape it belongs to."""

    global_rotations: Float[Tensor, "F 24 3 3"]
    joint_positions: Float[Tensor, "F 24 3"]
    """m."""
    rest_joints: Float[Tensor, "24 3"]
    shape: Float[Tensor, "B"]


def _levels() -> list[tuple[list[int], list[int], list[int]]]:
    """By depth in the tree: joints, their parents, and the parents' places in the level above."""
    depth = [0] * JOINT_COUNT
    for joint in range(1, JOINT_COUNT):
        depth[joint] = depth[PARENTS[joint]] + 1
    members = [[j for j in range(JOINT_COUNT) if depth[j] == d] for d in range(max(depth) + 1)]
    return [
        (joints, [PARENTS[j] for j in joints], [above.index(PARENTS[j]) for j in joints])
        for above, joints in pairwise(members)
    ]


LEVELS = _levels()
_IN_ORDER = np.argsort([0] + [joint for joints, _, _ in LEVELS for joint in joints])


def rotation_matrices(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Rodrigues' formula, differentiable at zero too."""
    x, y, z = axis_angle.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*x.shape, 3, 3)
    angle = (axis_angle.square().sum(-1) + 1e-12).sqrt()[..., None, None]
    sine, versine = torch.sinc(angle / math.pi), 0.5 * torch.sinc(angle / (2.0 * math.pi)) ** 2
    return torch.eye(3) + sine * cross + versine * (cross @ cross)


def forward_kinematics(
    rotations: Float[Tensor, "F 24 3 3"], root: Float[Tensor, "F 3"], rest: Float[Tensor, "24 3"]
) -> tuple[Float[Tensor, "F 24 3 3"], Float[Tensor, "F 24 3"]]:
    """Global rotations and positions of all joints; `root` is the position of joint 0 itself."""
    global_rotations, joint_positions = [rotations[:, :1]], [root[:, None]]
    for joints, parents, places in LEVELS:
        above = global_rotations[-1][:, places]
        bones = (rest[joints] - rest[parents])[None, :, :, None]
        joint_positions.append(joint_positions[-1][:, places] + (above @ bones)[..., 0])
        global_rotations.append(above @ rotations[:, joints])
    return torch.cat(global_rotations, 1)[:, _IN_ORDER], torch.cat(joint_positions, 1)[:, _IN_ORDER]


def rigid_points(
    posed: PosedBody, points: Float[Tensor, "N 3"], joints: Int[Tensor, "N"]
) -> Float[Tensor, "F N 3"]:
    """Rest `points`, each moved rigidly with its own joint."""
    local = (points - posed.rest_joints[joints])[None, :, :, None]
    return posed.joint_positions[:, joints] + (posed.global_rotations[:, joints] @ local)[..., 0]


def skinned_points(
    posed: PosedBody, points: Float[Tensor, "V 3"], blend_weights: Float[Tensor, "V 24"]
) -> Float[Tensor, "F V 3"]:
    """Rest `points` by linear blend skinning, as one product of matrices."""
    columns = skinning_transforms(posed).permute(1, 3, 0, 2).reshape(4 * JOINT_COUNT, -1)
    rows = blended_rows(points, blend_weights)
    return (rows @ columns).reshape(len(points), -1, 3).transpose(0, 1)


def skinning_transforms(posed: PosedBody) -> Float[Tensor, "F 24 3 4"]:
    """[R_k | s_k] of every joint, in x = sum_k w_k (R_k p + s_k)."""
    moved = (posed.global_rotations @ posed.rest_joints[None, :, :, None])[..., 0]
    return torch.cat([posed.global_rotations, (posed.joint_positions - moved)[..., None]], -1)


def blended_rows(
    points: Float[Tensor, "*batch 3"], weights: Float[Tensor, "*batch 24"]
) -> Float[Tensor, "*batch 96"]:
    """[w_k p, w_k] of all joints in the same; times the stacked transforms, the posed points."""
    homogeneous = torch.cat([points, torch.ones_like(points[..., :1])], -1)
    return (weights[..., None] * homogeneous[..., None, :]).flatten(-2)


def project(
    points: Float[Tensor, "*batch 3"], focal_px: Tensor, centre: Float[Tensor, "2"]
) -> Float[Tensor, "*batch 2"]:
    """Pixels of points; points at the camera are kept finite."""
    depth = (-points[..., 2:]).clamp_min(0.05)
    flipped = points[..., :2] * torch.tensor([1.0, -1.0])
    return centre + focal_px * flipped / depth
