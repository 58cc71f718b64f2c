"""Poses at random: what people do in front of a camera, wider than any recorded motion.

Standing, walking, crouching, kicking, sitting, bending; arms that hang, gesture, reach, or touch
the body. No pose was taken from recorded motion, so that what learns from these can be judged by
it; only how far joints usually turn, some ten numbers, was set after a look at it as a whole.
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
"""How far the upper arm turns about itself, rad: by its direction, and a radian of the elbow's
bend; forearms bend inwards. Fitted to recorded motion, whose spread about it is 0.37."""
_TOUCHES = 0.15
"""Share of arms whose hand is on or near the body."""
_TRIES = 48
"""Of an arm that shall touch the body: the nearest of so many is taken."""
_TOUCHED = ("head", "neck", "spine3", "spine1", "pelvis", "left_shoulder", "right_shoulder",
            "left_elbow", "right_elbow", "left_hip", "right_hip", "left_knee",
            "right_knee")  # fmt: skip
_FEET = list(FOOT_JOINTS)


def random_pose(rng: np.random.Generator, skeleton: Skeleton) -> Pose:
    """One pose of a person who stands at x = z = 0, feet on the floor, facing anywhere."""
    angles = np.zeros((JOINT_COUNT, 3))
    pitch = _trunk(rng, angles)
    _legs(rng, angles, pitch)
    alike = rng.uniform() < 0.3
    first = _arm(rng)
    for (side, out), arm in zip(_SIDES, (first, first if alike else _arm(rng)), strict=True):
        _set_arm(angles, side, out, arm + 0.08 * rng.normal(size=arm.shape))
    for side, out in _SIDES:
        if rng.uniform() < _TOUCHES:
            _touch(rng, angles, side, out, skeleton)
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
    turn = np.array([bend - pitch, rng.normal(0.0, 0.3), rng.normal(0.0, 0.15)])
    for name, share in zip(("spine1", "spine2", "spine3"), shares, strict=True):
        angles[_J[name]] = share * turn + 0.03 * rng.normal(size=3)
    look = np.array([rng.normal(0.05, 0.3), rng.normal(0.0, 0.5), rng.normal(0.0, 0.15)])
    angles[_J["neck"]], angles[_J["head"]] = 0.4 * look, 0.6 * look
    angles[0] = [pitch, 0.0, rng.normal(0.0, 0.08)]
    return pitch


def _legs(rng: np.random.Generator, angles: Array, pitch: float) -> None:
    """[hip flexion, knee flexion] of each leg by what the person does, then the rest."""
    doing = rng.uniform()
    flex = np.abs(rng.normal(0.0, 0.08, 2))[:, None] * [1.0, 2.0]
    if doing < 0.35:  # walks
        phase, stride = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3, 1.3)
        phases = phase + np.array([0.0, np.pi])
        flex[:, 0] = stride * (0.08 + 0.42 * np.sin(phases))
        flex[:, 1] = 0.12 + stride * 0.5 * (1.0 + np.sin(phases + 1.0)) * (np.cos(phases) > -0.3)
    elif doing < 0.55:  # crouches, lands, sits
        depth = rng.uniform(0.1, 1.5)
        flex = depth * rng.normal(1.0, 0.1, (2, 2)) * [1.0, rng.uniform(1.2, 2.0)]
    elif doing < 0.7:  # lifts or swings one leg
        flex[rng.integers(2)] = [rng.uniform(-0.6, 1.7), rng.uniform(0.0, 2.0)]
    elif doing < 0.8:  # stands wide or lunges
        flex[:, 0] += rng.normal(0.0, 0.4, 2)
        flex[:, 1] += np.abs(rng.normal(0.0, 0.4, 2))
    spread = 0.05 + np.abs(rng.normal(0.0, 0.15 if doing < 0.8 else 0.3))
    for (side, out), (hip, knee) in zip(_SIDES, flex, strict=True):
        thigh = -(hip + pitch)
        turned_out = out * rng.normal(0.08, 0.2)
        angles[_J[f"{side}_hip"]] = [thigh, turned_out, out * spread + rng.normal(0.0, 0.05)]
        angles[_J[f"{side}_knee"]] = [max(knee, 0.0), rng.normal(0.0, 0.08), rng.normal(0.0, 0.04)]
        level = np.clip(-(thigh + pitch + max(knee, 0.0)), -0.7, 0.6)
        flat = level if rng.uniform() < 0.7 else level * rng.uniform()
        angles[_J[f"{side}_ankle"]] = rng.normal([flat, 0.0, 0.0], [0.15, 0.1, 0.1])
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


def _set_arm(angles: Array, side: str, out: float, arm: Array) -> None:
    """Hang the arm, swing it to its direction, twist; the right arm is the left's mirror image."""
    along = arm[:3] / np.linalg.norm(arm[:3])
    hang = axis_angle_to_matrix(np.array([0.0, 0.0, -_HANGING_RAD]))
    swing = rotation_between(hang @ np.array([1.0, 0.0, 0.0]), along)
    shoulder = swing @ hang @ axis_angle_to_matrix(np.array([arm[3], 0.0, 0.0]))
    hinge = np.array(ELBOW_HINGE["left"])
    pronation = axis_angle_to_matrix(np.array([arm[5], 0.0, 0.0]))
    elbow = axis_angle_to_matrix(abs(arm[4]) * hinge) @ pronation
    mirror = np.array([1.0, out, out])  # of an axis-angle about the plane x = 0
    angles[_J[f"{side}_shoulder"]] = mirror * matrix_to_axis_angle(shoulder)
    angles[_J[f"{side}_elbow"]] = mirror * matrix_to_axis_angle(elbow)
    angles[_J[f"{side}_wrist"]] = mirror * arm[6:9]
    angles[_J[f"{side}_collar"]] = mirror * np.array([0.0, arm[9], arm[10]])


def _touch(
    rng: np.random.Generator, angles: Array, side: str, out: float, skeleton: Skeleton
) -> None:
    """Put the hand of `side` near the skin over one of the joints."""
    arms = [_arm(rng) for _ in range(_TRIES)]
    tried = np.repeat(angles[None], _TRIES, axis=0)
    for pose, arm in zip(tried, arms, strict=True):
        _set_arm(pose, side, out, arm)
    moved = skeleton.joint_transforms(tried, np.zeros((_TRIES, 3)))
    hand = moved[:, _J[f"{side}_hand"], :3, 3]
    touched = [name for name in _TOUCHED if not name.startswith(side)]
    joint = moved[:, _J[touched[rng.integers(len(touched))]]]
    skin = joint[:, :3, 3] + 0.13 * joint[:, :3, 2]
    nearest = np.linalg.norm(hand - skin, axis=1).argmin()
    _set_arm(angles, side, out, arms[nearest])
