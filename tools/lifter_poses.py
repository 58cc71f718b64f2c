"""Random poses of people in front of a camera, of wider variety than recorded motion.

Standing, walking, crouching, kicking, sitting, bending; arms that hang, gesture, reach, or touch
the body. No pose is taken from recorded motion, so that networks trained on these can be tested on
it; only the usual ranges of joints, some ten numbers, were chosen by its statistics.
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float
from scene.limits import ELBOW_HINGE
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle, rotation_between
from scene.skeleton import FOOT_JOINTS, JOINT_COUNT, JOINT_NAMES, Skeleton

_J = {name: index for index, name in enumerate(JOINT_NAMES)}
_SIDES = (("left", 1.0), ("right", -1.0))
_HANGING_RAD = 1.35
_TWIST = np.array([-0.35, -0.15, 0.4, 0.45])
"""Rotation of the upper arm about its own axis, rad, by its direction and by a radian of the
elbow's bend, since forearms bend inwards. Fitted to recorded motion, which
spreads about it by 0.37."""
_TOUCH_SHARE = 0.15
"""Share of arms whose hand is on or near the body."""
_TOUCH_CANDIDATES = 48
"""Random arms drawn for a hand on the body, of which the nearest is taken."""
_TOUCH_JOINTS = (
    "head",
    "neck",
    "spine3",
    "spine1",
    "pelvis",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
)
_FEET = list(FOOT_JOINTS)


def random_pose(rng: np.random.Generator, skeleton: Skeleton) -> Pose:
    """One pose of a person who stands at x = z = 0, feet on the floor, facing anywhere."""
    angles = np.zeros((JOINT_COUNT, 3))
    pitch = _trunk(rng, angles)
    _legs(rng, angles, pitch)
    symmetric = rng.uniform() < 0.3
    left_arm = _arm(rng)
    for (side, sign), arm in zip(
        _SIDES, (left_arm, left_arm if symmetric else _arm(rng)), strict=True
    ):
        _set_arm(angles, side, sign, arm + 0.08 * rng.normal(size=arm.shape))
    for side, sign in _SIDES:
        if rng.uniform() < _TOUCH_SHARE:
            _place_hand_on_body(rng, angles, side, sign, skeleton)
    yaw = axis_angle_to_matrix(np.array([0.0, rng.uniform(-np.pi, np.pi), 0.0]))
    lean = axis_angle_to_matrix(rng.normal(0.0, 0.35, 3) * [1.0, 0.0, 1.0] * (rng.uniform() < 0.3))
    angles[0] = matrix_to_axis_angle(yaw @ lean @ axis_angle_to_matrix(angles[0]))
    heights = skeleton.joint_transforms(angles[None], np.zeros((1, 3)))[0, _FEET, 1, 3]
    lift = -(heights - skeleton.rest_joints[_FEET, 1]).min()
    return Pose(angles, np.array([0.0, lift, 0.0]))


def _trunk(rng: np.random.Generator, angles: Array) -> float:
    """Bends, leans, twists; returns how far the pelvis pitches forwards, rad."""
    bend = rng.uniform(0.0, 2.2) if rng.uniform() < 0.3 else rng.normal(0.08, 0.15)
    pitch = bend * rng.uniform(0.2, 0.8)
    shares = rng.dirichlet([6.0, 2.0, 1.0])
    rotation = np.array([bend - pitch, rng.normal(0.0, 0.3), rng.normal(0.0, 0.15)])
    for name, share in zip(("spine1", "spine2", "spine3"), shares, strict=True):
        angles[_J[name]] = share * rotation + 0.03 * rng.normal(size=3)
    head_rotation = np.array([rng.normal(0.05, 0.3), rng.normal(0.0, 0.5), rng.normal(0.0, 0.15)])
    angles[_J["neck"]], angles[_J["head"]] = 0.4 * head_rotation, 0.6 * head_rotation
    angles[0] = [pitch, 0.0, rng.normal(0.0, 0.08)]
    return pitch


def _legs(rng: np.random.Generator, angles: Array, pitch: float) -> None:
    """Sets [hip flexion, knee flexion] of each leg by a random activity, then the other angles."""
    activity = rng.uniform()
    flex = np.abs(rng.normal(0.0, 0.08, 2))[:, None] * [1.0, 2.0]
    if activity < 0.35:  # walks
        phase, stride = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3, 1.3)
        phases = phase + np.array([0.0, np.pi])
        flex[:, 0] = stride * (0.08 + 0.42 * np.sin(phases))
        flex[:, 1] = 0.12 + stride * 0.5 * (1.0 + np.sin(phases + 1.0)) * (np.cos(phases) > -0.3)
    elif activity < 0.55:  # crouches, lands, sits
        depth = rng.uniform(0.1, 1.5)
        flex = depth * rng.normal(1.0, 0.1, (2, 2)) * [1.0, rng.uniform(1.2, 2.0)]
    elif activity < 0.7:  # lifts or swings one leg
        flex[rng.integers(2)] = [rng.uniform(-0.6, 1.7), rng.uniform(0.0, 2.0)]
    elif activity < 0.8:  # stands wide or lunges
        flex[:, 0] += rng.normal(0.0, 0.4, 2)
        flex[:, 1] += np.abs(rng.normal(0.0, 0.4, 2))
    spread = 0.05 + np.abs(rng.normal(0.0, 0.15 if activity < 0.8 else 0.3))
    for (side, sign), (hip, knee) in zip(_SIDES, flex, strict=True):
        thigh = -(hip + pitch)
        outward_rotation = sign * rng.normal(0.08, 0.2)
        angles[_J[f"{side}_hip"]] = [thigh, outward_rotation, sign * spread + rng.normal(0.0, 0.05)]
        angles[_J[f"{side}_knee"]] = [max(knee, 0.0), rng.normal(0.0, 0.08), rng.normal(0.0, 0.04)]
        level_angle = np.clip(-(thigh + pitch + max(knee, 0.0)), -0.7, 0.6)
        ankle = level_angle if rng.uniform() < 0.7 else level_angle * rng.uniform()
        angles[_J[f"{side}_ankle"]] = rng.normal([ankle, 0.0, 0.0], [0.15, 0.1, 0.1])
        angles[_J[f"{side}_foot"], 0] = rng.normal(0.0, 0.1)


def _arm(rng: np.random.Generator) -> Float[Array, "11"]:
    """Direction of the left upper arm (3), its twist, the elbow's bend and twist, wrist (3),
    collar (2)."""
    if rng.uniform() < 0.4:
        along = np.array([0.15, -1.0, 0.0]) + rng.normal(0.0, [0.12, 0.1, 0.25])
        bend = abs(rng.normal(0.6, 0.4))
    else:
        along = rng.normal(0.0, 1.0, 3)
        along = along / np.linalg.norm(along) + [0.35, -0.2, 0.35]
        bend = rng.uniform(0.0, 2.5)
    along = along / np.linalg.norm(along)
    twist = _TWIST @ [*along, bend] + rng.normal(0.0, 0.4)
    collar = rng.normal([0.0, 0.1 * max(0.0, along[1] + 0.3)], 0.05)
    wrist = rng.normal([-0.2, 0.0, 0.0], [0.45, 0.1, 0.12])
    return np.concatenate([along, [twist, bend, rng.normal(0.0, 0.05)], wrist, collar])


def _set_arm(angles: Array, side: str, sign: float, arm: Array) -> None:
    """Hang the arm, swing it to its direction, twist; the right arm is the left's mirror image."""
    along = arm[:3] / np.linalg.norm(arm[:3])
    hang = axis_angle_to_matrix(np.array([0.0, 0.0, -_HANGING_RAD]))
    swing = rotation_between(hang @ np.array([1.0, 0.0, 0.0]), along)
    shoulder = swing @ hang @ axis_angle_to_matrix(np.array([arm[3], 0.0, 0.0]))
    hinge = np.array(ELBOW_HINGE["left"])
    pronation = axis_angle_to_matrix(np.array([arm[5], 0.0, 0.0]))
    elbow = axis_angle_to_matrix(abs(arm[4]) * hinge) @ pronation
    mirror = np.array([1.0, sign, sign])  # of an axis-angle about the plane x = 0
    angles[_J[f"{side}_shoulder"]] = mirror * matrix_to_axis_angle(shoulder)
    angles[_J[f"{side}_elbow"]] = mirror * matrix_to_axis_angle(elbow)
    angles[_J[f"{side}_wrist"]] = mirror * arm[6:9]
    angles[_J[f"{side}_collar"]] = mirror * np.array([0.0, arm[9], arm[10]])


def _place_hand_on_body(
    rng: np.random.Generator, angles: Array, side: str, sign: float, skeleton: Skeleton
) -> None:
    """Put the hand of `side` near the skin over one of the joints."""
    arms = [_arm(rng) for _ in range(_TOUCH_CANDIDATES)]
    candidates = np.repeat(angles[None], _TOUCH_CANDIDATES, axis=0)
    for pose, arm in zip(candidates, arms, strict=True):
        _set_arm(pose, side, sign, arm)
    transforms = skeleton.joint_transforms(candidates, np.zeros((_TOUCH_CANDIDATES, 3)))
    hand = transforms[:, _J[f"{side}_hand"], :3, 3]
    joints = [name for name in _TOUCH_JOINTS if not name.startswith(side)]
    joint = transforms[:, _J[joints[rng.integers(len(joints))]]]
    skin = joint[:, :3, 3] + 0.13 * joint[:, :3, 2]
    nearest = np.linalg.norm(hand - skin, axis=1).argmin()
    _set_arm(angles, side, sign, arms[nearest])
