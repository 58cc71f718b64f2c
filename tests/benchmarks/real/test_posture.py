"""Leans and bows of known size are measured as such."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.real.posture import head_level_deg, head_pitch_deg, trunk_lean_deg
from scene.camera import Camera, look_at
from tests.capture.people import JOINT, body, standing

STANDING = standing(2)


def test_a_lean_is_measured_from_the_vertical():
    assert trunk_lean_deg(STANDING, body().skeleton).max() < 1.5
    angles = STANDING.joint_angles.copy()
    angles[1, 0] = [np.deg2rad(20.0), 0.0, 0.0]
    leaning = replace(STANDING, joint_angles=angles)
    assert trunk_lean_deg(leaning, body().skeleton)[1] == pytest.approx(20.0, abs=1.5)


def test_a_head_is_measured_from_the_direction_to_the_camera():
    at = STANDING.root_translation[0] + body().skeleton.rest_joints[JOINT["head"]]
    angles = STANDING.joint_angles.copy()
    angles[:, 0] = 0.0
    angles[1, JOINT["head"]] = [np.deg2rad(10.0), 0.0, 0.0]
    bowed = replace(STANDING, joint_angles=angles)
    level = Camera(np.eye(3), look_at(at + np.array([0.0, 0.0, 2.0]), at), 64, 48)
    assert head_pitch_deg(bowed, body().skeleton, level) == pytest.approx([0.0, -10.0], abs=1.0)
    assert head_level_deg(bowed, body().skeleton) == pytest.approx([0.0, -10.0], abs=1.0)
    below = Camera(np.eye(3), look_at(at + np.array([0.0, -2.0, 2.0]), at), 64, 48)
    assert head_pitch_deg(bowed, body().skeleton, below) == pytest.approx([45.0, 35.0], abs=1.0)
