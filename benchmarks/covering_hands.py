"""Performers who hold their hands before their chest, and who let them hang."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from capture.studio.motions import turntable_motion
from scene.arrays import Array, Float
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_NAMES, Skeleton

RATE_HZ = 10.0
_BEFORE_CHEST_M, _REACH_M, _UP_M = 0.22, 0.13, 0.12
_TURN_RAD = 0.15


def hands_away(frames: int) -> Motion:
    """Arms hang; the trunk turns a little to and fro."""
    motion = turntable_motion(frames, RATE_HZ, 0.0)
    phase = 2.0 * np.pi * np.arange(frames) / frames
    motion.joint_angles[:, 0, 1] = _TURN_RAD * np.sin(phase)
    return motion


def hands_before_chest(skeleton: Skeleton, frames: int) -> Motion:
    """The same, while each wrist goes round before its side of the chest."""
    motion = hands_away(frames)
    angles = motion.joint_angles.copy()
    arms = {side: arm_joints(side) for side in ("left", "right")}
    for number in range(frames):
        phase = 2.0 * np.pi * 3.0 * number / frames
        for side, sign in (("left", 1.0), ("right", -1.0)):
            middle = skeleton.rest_joints[JOINT_NAMES.index("spine3")]
            off = np.array(
                [sign * _REACH_M * np.cos(phase), _UP_M * np.sin(phase + sign), _BEFORE_CHEST_M]
            )
            angles[number, arms[side]] = reaching(skeleton, arms[side], sign, middle + off)
    return replace(motion, joint_angles=angles)


def arm_joints(side: str) -> list[int]:
    """Shoulder, elbow and wrist of `left` or `right`."""
    return [JOINT_NAMES.index(f"{side}_{part}") for part in ("shoulder", "elbow", "wrist")]


def reaching(
    skeleton: Skeleton, arm: list[int], sign: float, wrist: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """Rotations (rad) of the joints `arm` that bring the wrist there (m), the trunk at rest.

    `sign` is 1 for the left arm, -1 for the right.
    """
    hanging = axis_angle_to_matrix(np.array([0.0, 0.0, -1.1 * sign]))

    def rotations(numbers: Array) -> Float[Array, "3 3"]:
        shoulder = hanging @ axis_angle_to_matrix(numbers[:3])
        bend = np.array([0.0, -sign * numbers[3], 0.0])
        return np.stack([matrix_to_axis_angle(shoulder), bend, np.zeros(3)])

    def off(numbers: Array) -> Array:
        angles = np.zeros((len(JOINT_NAMES), 3))
        angles[arm] = rotations(numbers)
        placed = skeleton.joint_transforms(angles, np.zeros(3))[arm[2], :3, 3]
        return np.concatenate([10.0 * (placed - wrist), 0.1 * (numbers - start)])

    start = np.array([0.8, 0.0, 0.0, 1.8])
    bounds = ([-2.5, -2.5, -2.5, 0.1], [2.5, 2.5, 2.5, 2.5])
    return rotations(least_squares(off, start, bounds=bounds).x)
