"""How far a fitted motion is from the true one. F frames, 24 joints, camera frame, metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.motion import Motion
from scene.rotations import matrix_to_axis_angle
from scene.skeleton import JOINT_NAMES, Skeleton

JUDGED_JOINTS = (
    "pelvis",
    "spine3",
    "neck",
    "head",
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
)
"""The 16 joints whose rotations the estimator's landmarks show; the pelvis' is the whole body's."""
_JUDGED = [JOINT_NAMES.index(name) for name in JUDGED_JOINTS]
_SIDES = [
    (JOINT_NAMES.index(f"left_{part}"), JOINT_NAMES.index(f"right_{part}"))
    for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
]
_FEET = [JOINT_NAMES.index(name) for name in ("left_foot", "right_foot")]
_PLANTED_M_S = 0.15
"""A foot whose true speed is below this stands."""


@dataclass(frozen=True, eq=False)
class Joints:
    """Joints of a whole clip in the frame of its first camera."""

    times_s: Float[Array, "F"]
    positions: Float[Array, "F 24 3"]
    local_rotations: Float[Array, "F 24 3 3"]
    """Local rotations; the pelvis' from rest to the camera's frame."""


def seen_joints(skeleton: Skeleton, motion: Motion, world_to_camera: Float[Array, "3 4"]) -> Joints:
    """`motion` as the camera sees it."""
    moved = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
    rotation, shift = world_to_camera[:, :3], world_to_camera[:, 3]
    positions = moved[..., :3, 3] @ rotation.T + shift
    world = moved[..., :3, :3]
    local_rotations = world.copy()
    for joint, parent in enumerate(skeleton.parents):
        above = world[:, parent] if parent >= 0 else rotation.T
        local_rotations[:, joint] = np.swapaxes(above, -1, -2) @ world[:, joint]
    return Joints(motion.times_s, positions, local_rotations)


def pose_errors(fitted: Joints, truth: Joints) -> dict[str, float]:
    """Means over frames; each figure's name says its unit."""
    relative = [j.positions - j.positions[:, :1] for j in (fitted, truth)]
    off = np.linalg.norm(relative[0] - relative[1], axis=2)
    scale = gauge_scale(fitted.positions, truth.positions)
    scaled = np.linalg.norm(scale * relative[0] - relative[1], axis=2)
    rotation_error = geodesic_deg(
        fitted.local_rotations[:, _JUDGED], truth.local_rotations[:, _JUDGED]
    )
    root = np.linalg.norm(fitted.positions[:, 0] - truth.positions[:, 0], axis=1)
    root_scaled = np.linalg.norm(scale * fitted.positions[:, 0] - truth.positions[:, 0], axis=1)
    return {
        "joint_mm": 1e3 * float(off.mean()),
        "joint_one_scale_mm": 1e3 * float(scaled.mean()),
        "joint_procrustes_mm": 1e3 * float(procrustes(fitted.positions, truth.positions).mean()),
        "rotation_error_deg": float(rotation_error.mean()),
        "root_mm": 1e3 * float(root.mean()),
        "root_one_scale_mm": 1e3 * float(root_scaled.mean()),
        "scale": scale,
        "swapped_frames": float(swapped(*relative).sum()),
        "foot_slide_mm_s": 1e3 * foot_slide(fitted, truth),
        "foot_slide_truth_mm_s": 1e3 * foot_slide(truth, truth),
        "jitter_m_s3": jitter(fitted),
        "jitter_truth_m_s3": jitter(truth),
    }


def joint_rotation_errors(fitted: Joints, truth: Joints) -> dict[str, float]:
    """Mean error of each judged joint's local rotation, degrees."""
    rotation_error = geodesic_deg(
        fitted.local_rotations[:, _JUDGED], truth.local_rotations[:, _JUDGED]
    )
    return dict(zip(JUDGED_JOINTS, rotation_error.mean(axis=0).tolist(), strict=True))


def geodesic_deg(a: Float[Array, "*batch 3 3"], b: Float[Array, "*batch 3 3"]) -> Array:
    """Angle of the rotation between `a` and `b`, degrees."""
    between = np.swapaxes(a, -1, -2) @ b
    return np.degrees(np.linalg.norm(matrix_to_axis_angle(between), axis=-1))


def gauge_scale(fitted: Float[Array, "F J 3"], truth: Float[Array, "F J 3"]) -> float:
    """The one scale about the camera that brings the whole clip nearest.

    One camera can't tell a small person nearby from a tall one further away.
    """
    return float((fitted * truth).sum() / (fitted**2).sum())


def procrustes(fitted: Float[Array, "F J 3"], truth: Float[Array, "F J 3"]) -> Float[Array, "F J"]:
    """Distances after each frame's best rotation, shift and scale (Kabsch, Umeyama), m."""
    a = fitted - fitted.mean(axis=1, keepdims=True)
    b = truth - truth.mean(axis=1, keepdims=True)
    u, s, vt = np.linalg.svd(np.swapaxes(a, 1, 2) @ b)
    sign = np.ones_like(s)
    sign[:, 2] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * sign[:, None]) @ vt
    scale = (s * sign).sum(1) / (a**2).sum((1, 2))
    return np.linalg.norm(scale[:, None, None] * (a @ rotation) - b, axis=2)


def swapped(fitted: Float[Array, "F 24 3"], truth: Float[Array, "F 24 3"]) -> Array:
    """Frames [F] in which left and right fit better exchanged, over arms and legs together."""
    left, right = (np.array(side) for side in zip(*_SIDES, strict=True))
    both = np.concatenate([left, right])
    other = np.concatenate([right, left])
    straight = np.linalg.norm(fitted[:, both] - truth[:, both], axis=2).sum(1)
    crossed = np.linalg.norm(fitted[:, both] - truth[:, other], axis=2).sum(1)
    return crossed < straight


def foot_slide(moved: Joints, truth: Joints) -> float:
    """Mean speed, m/s, of the feet in `moved` while the true ones stand still."""
    steps = np.diff(truth.times_s)[:, None]
    true_speed = np.linalg.norm(np.diff(truth.positions[:, _FEET], axis=0), axis=2) / steps
    speed = np.linalg.norm(np.diff(moved.positions[:, _FEET], axis=0), axis=2) / steps
    planted = true_speed < _PLANTED_M_S
    return float(speed[planted].mean()) if planted.any() else 0.0


def jitter(moved: Joints) -> float:
    """Mean third derivative of the joints' positions, m/s^3 (uniform time steps)."""
    if len(moved.times_s) < 4:
        return 0.0
    step = float(np.median(np.diff(moved.times_s)))
    return float(np.linalg.norm(np.diff(moved.positions, 3, axis=0), axis=2).mean() / step**3)
