"""Poses at random: feet on the floor, joints that don't break, arms everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.capture.people import JOINT, body
from tools.lifter_poses import random_pose

FEET = [JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")]


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_nobody_floats_sinks_or_breaks_a_knee(seed):
    skeleton = body().skeleton
    pose = random_pose(np.random.default_rng(seed), skeleton)
    moved = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
    above = moved[FEET, 1, 3] - skeleton.rest_joints[FEET, 1]
    assert above.min() == pytest.approx(0.0, abs=1e-9)
    knees = pose.joint_angles[[JOINT["left_knee"], JOINT["right_knee"]], 0]
    assert (knees >= 0.0).all()
    assert np.isfinite(pose.joint_angles).all()


def test_hands_reach_every_side_of_the_chest_and_sides_are_alike():
    skeleton, rng = body().skeleton, np.random.default_rng(0)
    poses = [random_pose(rng, skeleton) for _ in range(200)]
    angles = np.stack([pose.joint_angles for pose in poses])
    moved = skeleton.joint_transforms(angles, np.zeros((len(poses), 3)))
    chest = moved[:, JOINT["spine3"]]
    hands = {}
    for side in ("left", "right"):
        away = moved[:, JOINT[f"{side}_wrist"], :3, 3] - chest[:, :3, 3]
        hands[side] = np.einsum("fji,fj->fi", chest[:, :3, :3], away)
    for hand in hands.values():
        for axis in range(3):
            assert hand[:, axis].min() < -0.1
            assert hand[:, axis].max() > 0.1
    spread = [hand.std(axis=0) for hand in hands.values()]
    assert spread[0] == pytest.approx(spread[1], rel=0.25)
