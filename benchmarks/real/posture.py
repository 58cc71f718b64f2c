"""How upright a captured person stands, and how far their head is bowed."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion
from scene.skeleton import JOINT_NAMES, Skeleton

_PELVIS, _NECK, _HEAD = (JOINT_NAMES.index(name) for name in ("pelvis", "neck", "head"))


def trunk_lean_deg(motion: Motion, skeleton: Skeleton) -> Float[Array, "F"]:
    """Angle between pelvis to neck and the world's vertical, in each frame."""
    joints = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)[..., :3, 3]
    trunk = joints[:, _NECK] - joints[:, _PELVIS]
    return np.rad2deg(np.arccos(trunk[:, 1] / np.linalg.norm(trunk, axis=1)))


def head_pitch_deg(motion: Motion, skeleton: Skeleton, camera: Camera) -> Float[Array, "F"]:
    """How far the head looks above the camera, in each frame; below it: negative."""
    head = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)[:, _HEAD]
    to_camera = camera.position - head[:, :3, 3]
    return head_level_deg(motion, skeleton) - _elevation_deg(to_camera)


def head_level_deg(motion: Motion, skeleton: Skeleton) -> Float[Array, "F"]:
    """How far the head looks above the level, in each frame; below it: negative."""
    head = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)[:, _HEAD]
    return _elevation_deg(head[:, :3, 2])


def _elevation_deg(directions: Float[Array, "F 3"]) -> Float[Array, "F"]:
    return np.rad2deg(np.arcsin(directions[:, 1] / np.linalg.norm(directions, axis=1)))
