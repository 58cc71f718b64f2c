"""A prior of everyday poses: usual deviations of joints and limits of hinges. In torch."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from scene.arrays import Float, Tensor
from scene.limits import ELBOW_HINGE, FARTHEST_BEND_RAD
from scene.skeleton import JOINT_COUNT, JOINT_NAMES

_HIDDEN_DEVIATION_RAD = 0.03
"""Deviation of a joint that is never visible."""
_LIMIT_DEVIATION_RAD = 0.05
"""Deviation beyond a hinge's limit."""

_J = {name: index for index, name in enumerate(JOINT_NAMES)}


@dataclass(frozen=True)
class PosePrior:
    """Gaussians of the joint angles, and limits of the hinges."""

    mean: Float[Tensor, "24 3"]
    deviation: Float[Tensor, "24 3"]
    """rad, of the axis-angle's components along `axes`."""
    axes: Float[Tensor, "24 3 3"]
    """Rows: the directions along which each joint's spread is independent, T-pose's axes."""

    def energy(
        self, angles: Float[Tensor, "F 24 3"], hidden: Float[Tensor, "*frames 24"]
    ) -> Float[Tensor, "F"]:
        """Gaussian about the mean, and soft limits of the hinges.

        `hidden` joints (1) are tied to the mean: the silhouette alone does not determine them.
        """
        along = torch.einsum("jka,fja->fjk", self.axes, angles - self.mean)
        spread = (along / self.deviation).square().sum(2)[:, 1:]
        fixed = (angles - self.mean).square().sum(2)[:, 1:] / _HIDDEN_DEVIATION_RAD**2
        return torch.lerp(spread, fixed, hidden[..., 1:]).sum(1) + _hinge_limits(angles)


def pose_prior() -> PosePrior:
    """Deviations of everyday motion; elbows and knees are hinges with some twist."""
    mean, deviation = torch.zeros(JOINT_COUNT, 3), torch.full((JOINT_COUNT, 3), 0.25)
    wide = {
        "neck": 0.2,
        "head": 0.3,
        "collar": 0.2,
        "shoulder": 1.0,
        "wrist": 0.45,
        "hip": 0.8,
        "ankle": 0.35,
        "foot": 0.12,
        "hand": 0.05,
    }
    for name, index in _J.items():
        part = name.split("_")[-1]
        if part in wide:
            deviation[index] = wide[part]
    axes = torch.eye(3).repeat(JOINT_COUNT, 1, 1)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        mean[_J[f"{side}_shoulder"], 2] = -sign * 1.0  # arms hang rather than stand out
        hinge = torch.tensor(ELBOW_HINGE[side])
        axes[_J[f"{side}_elbow"], 1] = hinge
        axes[_J[f"{side}_elbow"], 2] = torch.linalg.cross(torch.tensor([1.0, 0.0, 0.0]), hinge)
        deviation[_J[f"{side}_elbow"]] = torch.tensor([0.3, 1.5, 0.1])
        deviation[_J[f"{side}_knee"]] = torch.tensor([1.5, 0.15, 0.1])
        deviation[_J[f"{side}_hip"], 1] = 0.4
    return PosePrior(mean, deviation, axes)


def _hinge_limits(angles: Tensor) -> Tensor:
    """Elbows and knees neither overextend nor bend beyond their limit."""
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
    return (over / _LIMIT_DEVIATION_RAD).square().sum(1)
