"""The body in torch, and the terms of the clip-wide fit. Batched over frames, float32.

Frame of the fit ("seen"): y up, z towards the camera, origin at the camera, so that a person who
faces the camera faces +z as at rest. F frames, J = 24 joints, L = 33 landmarks, V sampled vertices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch

from scene.arrays import Array, Float, Tensor
from scene.limits import ELBOW_HINGE, FARTHEST_BEND_RAD
from scene.skeleton import FOOT_JOINTS, JOINT_COUNT, JOINT_NAMES, PARENTS

_SWINGS = 3.0
"""Deviations of a foot's speed from which it is let go."""
_HELD_RAD = 0.03
"""Deviation of a joint that nothing shows."""

_J = {name: index for index, name in enumerate(JOINT_NAMES)}
_FEET = list(FOOT_JOINTS)


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


def forward(
    rotations: Float[Tensor, "F 24 3 3"], root: Float[Tensor, "F 3"], rest: Float[Tensor, "24 3"]
) -> tuple[Float[Tensor, "F 24 3 3"], Float[Tensor, "F 24 3"]]:
    """World rotations and positions of all joints; `root` is the place of joint 0 itself."""
    turned, placed = [rotations[:, :1]], [root[:, None]]
    for joints, parents, places in LEVELS:
        above = turned[-1][:, places]
        bones = (rest[joints] - rest[parents])[None, :, :, None]
        placed.append(placed[-1][:, places] + (above @ bones)[..., 0])
        turned.append(above @ rotations[:, joints])
    return torch.cat(turned, 1)[:, _IN_ORDER], torch.cat(placed, 1)[:, _IN_ORDER]


def rigid_points(
    turned: Float[Tensor, "F 24 3 3"],
    placed: Float[Tensor, "F 24 3"],
    rest_joints: Float[Tensor, "24 3"],
    points: Float[Tensor, "N 3"],
    joints: Tensor,
) -> Float[Tensor, "F N 3"]:
    """Rest `points`, each moved rigidly with its own joint."""
    local = (points - rest_joints[joints])[None, :, :, None]
    return placed[:, joints] + (turned[:, joints] @ local)[..., 0]


def skinned_points(
    turned: Float[Tensor, "F 24 3 3"],
    placed: Float[Tensor, "F 24 3"],
    rest_joints: Float[Tensor, "24 3"],
    points: Float[Tensor, "V 3"],
    weights: Float[Tensor, "V 24"],
) -> Float[Tensor, "F V 3"]:
    """Rest `points` by linear blend skinning, as one product of matrices."""
    transforms = blend_transforms(turned, placed, rest_joints)
    columns = transforms.permute(1, 3, 0, 2).reshape(4 * JOINT_COUNT, -1)
    return (blend_rows(points, weights) @ columns).reshape(len(points), -1, 3).transpose(0, 1)


def blend_transforms(
    turned: Float[Tensor, "F 24 3 3"], placed: Float[Tensor, "F 24 3"], rest: Float[Tensor, "24 3"]
) -> Float[Tensor, "F 24 3 4"]:
    """[R_k | s_k] of every joint, in x = sum_k w_k (R_k p + s_k)."""
    shift = placed - (turned @ rest[None, :, :, None])[..., 0]
    return torch.cat([turned, shift[..., None]], -1)


def blend_rows(
    points: Float[Tensor, "*batch 3"], weights: Float[Tensor, "*batch 24"]
) -> Float[Tensor, "*batch 96"]:
    """[w_k p, w_k] of all joints in the same; times the stacked transforms, the posed points."""
    homogeneous = torch.cat([points, torch.ones_like(points[..., :1])], -1)
    return (weights[..., None] * homogeneous[..., None, :]).flatten(-2)


def project(
    points: Float[Tensor, "*batch 3"], focal_px: Tensor, centre: Float[Tensor, "2"]
) -> Float[Tensor, "*batch 2"]:
    """Pixels of points of the seen frame; points at the camera are kept finite."""
    depth = (-points[..., 2:]).clamp_min(0.05)
    flipped = points[..., :2] * torch.tensor([1.0, -1.0])
    return centre + focal_px * flipped / depth


def robust(squared: Tensor) -> Tensor:
    """Pseudo-Huber of a squared residual in units of its deviation: quadratic, then linear."""
    return 2.0 * ((1.0 + squared).sqrt() - 1.0)


def very_robust(squared: Tensor, width: float) -> Tensor:
    """Geman-McClure: residuals beyond `width` deviations have no pull left."""
    return squared / (1.0 + squared / width**2)


@dataclass(frozen=True)
class PosePrior:
    """How far each joint leaves its rest, and which way it can't bend at all."""

    mean: Float[Tensor, "24 3"]
    deviation: Float[Tensor, "24 3"]
    """rad, of the axis-angle's components along `axes`."""
    axes: Float[Tensor, "24 3 3"]
    """Rows: the directions along which each joint's spread is independent, T-pose's axes."""

    def energy(
        self, angles: Float[Tensor, "F 24 3"], hidden: Float[Tensor, "*frames 24"]
    ) -> Float[Tensor, "F"]:
        """Gaussian about the mean, and walls at the hinges' ends.

        `hidden` joints (1) are held at the mean: the silhouette alone would bend them at will.
        """
        along = torch.einsum("jka,fja->fjk", self.axes, angles - self.mean)
        spread = (along / self.deviation).square().sum(2)[:, 1:]
        held = (angles - self.mean).square().sum(2)[:, 1:] / _HELD_RAD**2
        return torch.lerp(spread, held, hidden[..., 1:]).sum(1) + _hinge_walls(angles)


def pose_prior() -> PosePrior:
    """Deviations of everyday motion; elbows and knees are hinges with some twist."""
    mean, deviation = torch.zeros(JOINT_COUNT, 3), torch.full((JOINT_COUNT, 3), 0.25)
    wide = {"neck": 0.2, "head": 0.3, "collar": 0.2, "shoulder": 1.0, "wrist": 0.45,
            "hip": 0.8, "ankle": 0.35, "foot": 0.12, "hand": 0.05}  # fmt: skip
    for name, index in _J.items():
        part = name.split("_")[-1]
        if part in wide:
            deviation[index] = wide[part]
    axes = torch.eye(3).repeat(JOINT_COUNT, 1, 1)
    for side, out in (("left", 1.0), ("right", -1.0)):
        mean[_J[f"{side}_shoulder"], 2] = -out * 1.0  # arms hang rather than stand out
        hinge = torch.tensor(ELBOW_HINGE[side])
        axes[_J[f"{side}_elbow"], 1] = hinge
        axes[_J[f"{side}_elbow"], 2] = torch.linalg.cross(torch.tensor([1.0, 0.0, 0.0]), hinge)
        deviation[_J[f"{side}_elbow"]] = torch.tensor([0.3, 1.5, 0.1])
        deviation[_J[f"{side}_knee"]] = torch.tensor([1.5, 0.15, 0.1])
        deviation[_J[f"{side}_hip"], 1] = 0.4
    return PosePrior(mean, deviation, axes)


def _hinge_walls(angles: Tensor) -> Tensor:
    """Elbows and knees neither overstretch nor close further than they can."""
    bends = torch.stack(
        [
            angles[:, _J["left_elbow"]] @ torch.tensor(ELBOW_HINGE["left"]),
            angles[:, _J["right_elbow"]] @ torch.tensor(ELBOW_HINGE["right"]),
            angles[:, _J["left_knee"], 0],
            angles[:, _J["right_knee"], 0],
        ],
        1,
    )
    over = torch.relu(-bends) + torch.relu(bends - FARTHEST_BEND_RAD)
    return (over / 0.05).square().sum(1)


def unsteadiness(
    joints: Float[Tensor, "F J 3"], before: Tensor, after: Tensor, deviation_m_s2: float
) -> Float[Tensor, "F J"]:
    """Robust acceleration energy of frames 1..F-2; `before`, `after` are the steps in time, s.

    Frames at a cut have an infinite step and no energy.
    """
    if len(joints) < 3:
        return joints.new_zeros(0, joints.shape[1])
    speed = (joints[1:] - joints[:-1]) / before[:, None, None]
    acceleration = (speed[1:] - speed[:-1]) / after[:, None, None]
    return robust((acceleration / deviation_m_s2).square().sum(-1))


def sliding(joints: Float[Tensor, "F 24 3"], before: Tensor, deviation_m_s: float) -> Tensor:
    """Mean energy of feet that move between frames, `before` s apart.

    Slow ones are held where they stand, so that they neither slide nor let the body drift in
    depth; fast ones swing.
    """
    speed = (joints[1:, _FEET] - joints[:-1, _FEET]) / before[:, None, None]
    slid = very_robust((speed / deviation_m_s).square().sum(-1), _SWINGS)
    return slid.sum() / len(joints)


def time_steps(times_s: Array, takes: Array) -> tuple[Tensor, Tensor]:
    """Steps between neighbours [F-1] and between their middles [F-2], s; infinite at cuts."""
    steps = np.diff(times_s)
    middles = 0.5 * (steps[1:] + steps[:-1])
    cut = np.diff(takes) != 0
    middles = np.where(cut[1:] | cut[:-1], np.inf, middles)
    steps = np.where(cut, np.inf, steps)
    return torch.tensor(steps, dtype=torch.float32), torch.tensor(middles, dtype=torch.float32)
