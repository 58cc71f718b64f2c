"""A prior of everyday poses: how far joints bend, and which way they can't. In torch."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from scene.arrays import Float, Tensor
from scene.limits import ELBOW_HINGE, FARTHEST_BEND_RAD
from scene.skeleton import JOINT_COUNT, JOINT_NAMES

_HELD_RAD = 0.03
"""Deviation of a joint that nothing shows."""
_WALL_RAD = 0.05
"""Deviation beyond a hinge's end."""

_J = {name: index for index, name in enumerate(JOINT_NAMES)}


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
    return (over / _WALL_RAD).square().sum(1)
