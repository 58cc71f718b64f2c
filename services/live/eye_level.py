"""Heads held level: whoever looks into a webcam looks at the people they meet.

A webcam stands below or above its owner's eyes, and who looks into it bows or raises the head by as
much. Seen from eye level, where the others of a meeting are, that head looks at the floor and
shows its top, which the webcam never saw. So neck and head are turned back, half each, by how far
the head looks below or above the horizon in the mean; nods and looks aside stay as they are.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce

import numpy as np

from scene.arrays import Array, Float
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import HEAD, JOINT_NAMES, Skeleton
from services.live.settling_mean import SettlingMean

_FROM_PELVIS = [
    JOINT_NAMES.index(name) for name in ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
]
_TURNED = _FROM_PELVIS[-2:]
_FARTHEST_RAD = math.radians(25.0)
"""No webcam is further from the eyes' height; a head that is bowed by more is meant to be."""


def with_level_gaze(skeleton: Skeleton, motion: Motion) -> Motion:
    """`motion`, in which the head of a body of `skeleton` looks level in the mean."""
    joints = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
    below_rad = float(below_horizon(joints[:, HEAD, :3, :3]).mean())
    angles = motion.joint_angles.copy()
    local = axis_angle_to_matrix(angles[:, _TURNED]) @ _raising(below_rad)
    angles[:, _TURNED] = matrix_to_axis_angle(local)
    return replace(motion, joint_angles=angles)


class LevelGaze:
    """How far below the horizon somebody looks who is seen live; belongs to one thread."""

    def __init__(self) -> None:
        self._below_rad = SettlingMean(0.0)

    def learn(self, local: Float[Array, "24 3 3"], step_s: float) -> None:
        """Note where the head looks by joints' local rotations, `step_s` after the last time."""
        self._below_rad.add(float(below_horizon(head_in_room(local))), step_s)

    def raised(self, local: Float[Array, "24 3 3"]) -> Float[Array, "24 3 3"]:
        """Joints' local rotations with the head raised as far as was learnt."""
        local = local.copy()
        local[_TURNED] = local[_TURNED] @ _raising(self._below_rad.value)
        return local


def head_in_room(local: Float[Array, "24 3 3"]) -> Float[Array, "3 3"]:
    """The head's rotation, from rest, by the joints' own."""
    return reduce(np.matmul, local[_FROM_PELVIS])


def below_horizon(head: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch"]:
    """How far (rad) heads of these rotations in the room look below the horizon; above:
    negative."""
    return -np.arcsin(np.clip(head[..., 1, 2], -1.0, 1.0))


def _raising(below_rad: float) -> Float[Array, "3 3"]:
    """Half of the turn about a joint's own axis to the left that raises a head by `below_rad`."""
    half = 0.5 * min(max(below_rad, -_FARTHEST_RAD), _FARTHEST_RAD)
    cosine, sine = math.cos(half), math.sin(half)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])
