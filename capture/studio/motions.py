"""Synthetic motion: a slow full turn for training, and gestures for unseen poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scene.arrays import Array, Float
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_COUNT, JOINT_NAMES

_HANGING_RAD = 1.12
"""How far the arms hang down from the T-pose; a little away from the body."""


def _joint(name: str) -> int:
    return JOINT_NAMES.index(name)


def turntable_motion(frames: int, frames_per_second: float, turn_deg: float) -> Motion:
    """Standing, breathing, arms swinging a little, while turning by `turn_deg` degrees."""
    phase = np.linspace(0.0, 2.0 * np.pi, frames, endpoint=False)
    angles = np.zeros((frames, JOINT_COUNT, 3))
    sway = 0.12 * np.sin(2.0 * phase)
    _hang_arms(angles, 0.25 * np.sin(3.0 * phase), 0.2 * np.cos(2.0 * phase))
    angles[:, _joint("left_elbow"), 1] = -0.35 - 0.25 * np.sin(2.0 * phase)
    angles[:, _joint("right_elbow"), 1] = 0.35 + 0.25 * np.cos(2.0 * phase)
    angles[:, _joint("spine2"), 1] = sway
    angles[:, _joint("head"), 1] = -0.2 * np.sin(2.0 * phase)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        bend = 0.12 + 0.1 * sign * np.sin(2.0 * phase)
        angles[:, _joint(f"{side}_hip"), 0] = -bend
        angles[:, _joint(f"{side}_knee"), 0] = 2.0 * bend
        angles[:, _joint(f"{side}_ankle"), 0] = -bend
        angles[:, _joint(f"{side}_hip"), 2] = 0.06 * sign
    angles[:, 0, 1] = np.deg2rad(turn_deg) * np.arange(frames) / frames
    return _motion(angles, frames_per_second)


def gesture_motion(frames: int, frames_per_second: float) -> Motion:
    """Waving, lifting a knee, bending: nothing that `turntable_motion` has."""
    phase = np.linspace(0.0, 2.0 * np.pi, frames, endpoint=False)
    angles = np.zeros((frames, JOINT_COUNT, 3))
    _hang_arms(angles, 0.5 * np.sin(phase), 0.3 * np.cos(phase))
    angles[:, _joint("left_shoulder"), 2] = 0.2 + 0.5 * np.sin(phase)
    angles[:, _joint("left_elbow"), 2] = 0.9 + 0.4 * np.sin(3.0 * phase)
    angles[:, _joint("right_elbow"), 1] = 0.9 + 0.4 * np.sin(2.0 * phase)
    lift = np.maximum(np.sin(phase + 1.0), 0.0)
    angles[:, _joint("right_hip"), 0] = -0.9 * lift
    angles[:, _joint("right_knee"), 0] = 1.2 * lift
    angles[:, _joint("spine1"), 0] = 0.15 + 0.15 * np.cos(phase)
    angles[:, _joint("spine3"), 1] = 0.3 * np.sin(phase)
    angles[:, _joint("head"), 1] = 0.4 * np.cos(phase)
    angles[:, 0, 1] = phase
    return _motion(angles, frames_per_second)


def with_turn(motion: Motion, turn_deg: float) -> Motion:
    """`motion` with a slow turn of `turn_deg` degrees about the vertical added, on the spot."""
    yaw = np.zeros((len(motion), 3))
    yaw[:, 1] = np.deg2rad(turn_deg) * np.arange(len(motion)) / len(motion)
    rotation = axis_angle_to_matrix(yaw)
    angles = motion.joint_angles.copy()
    angles[:, 0] = matrix_to_axis_angle(rotation @ axis_angle_to_matrix(angles[:, 0]))
    root = np.einsum("fij,fj->fi", rotation, motion.root_translation)
    return replace(motion, joint_angles=angles, root_translation=root)


def _hang_arms(angles: Array, swing: Float[Array, "F"], lift: Float[Array, "F"]) -> None:
    angles[:, _joint("left_shoulder"), 2] = -_HANGING_RAD + 0.35 * lift
    angles[:, _joint("right_shoulder"), 2] = _HANGING_RAD - 0.3 * lift
    angles[:, _joint("left_shoulder"), 1] = -swing
    angles[:, _joint("right_shoulder"), 1] = -swing


def _motion(angles: Float[Array, "F 24 3"], frames_per_second: float) -> Motion:
    frames = len(angles)
    times = np.arange(frames) / frames_per_second
    return Motion(times, angles, np.zeros((frames, 3)), np.ones((frames, JOINT_COUNT)))
