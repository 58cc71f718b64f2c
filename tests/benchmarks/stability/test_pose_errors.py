"""Errors of a fitted motion: nil for the truth, known for known mistakes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.stability.pose_errors import (
    JUDGED_JOINTS,
    Joints,
    gauge_scale,
    joint_rotation_errors,
    pose_errors,
    procrustes,
    seen_joints,
    swapped,
)
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import JOINT_NAMES
from tests.capture.people import body, camera, standing


@pytest.fixture(scope="module")
def truth() -> Joints:
    return seen_joints(body().skeleton, standing(12, turn_rad=1.0), camera().world_to_camera)


def test_the_truth_has_no_error(truth):
    errors = pose_errors(truth, truth)
    for name in (
        "joint_mm",
        "joint_procrustes_mm",
        "rotation_error_deg",
        "root_mm",
        "swapped_frames",
    ):
        assert errors[name] == pytest.approx(0.0, abs=1e-4)
    assert errors["scale"] == pytest.approx(1.0)


def test_joints_are_where_the_camera_sees_them(truth):
    motion, view = standing(12, turn_rad=1.0), camera()
    skeleton = body().skeleton
    moved = skeleton.joint_transforms(motion.joint_angles[5], motion.root_translation[5])
    pixels, _ = view.project(moved[:, :3, 3])
    seen = truth.positions[5] @ view.intrinsics.T
    np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], pixels, atol=1e-9)


def test_one_scale_about_the_camera_is_taken_out(truth):
    errors = pose_errors(replace(truth, positions=truth.positions / 1.1), truth)
    assert errors["scale"] == pytest.approx(1.1)
    assert errors["root_mm"] > 100.0
    assert errors["root_one_scale_mm"] == pytest.approx(0.0, abs=1e-6)
    assert errors["joint_one_scale_mm"] == pytest.approx(0.0, abs=1e-6)
    assert gauge_scale(truth.positions / 1.1, truth.positions) == pytest.approx(1.1)


def test_procrustes_takes_out_rotation_shift_and_scale(truth):
    rotation = axis_angle_to_matrix(np.array([0.2, -0.4, 0.3]))
    moved = 0.8 * truth.positions @ rotation.T + [0.1, 0.2, -0.3]
    np.testing.assert_allclose(procrustes(moved, truth.positions), 0.0, atol=1e-9)


def test_a_rotated_joint_counts_alone(truth):
    elbow = JOINT_NAMES.index("left_elbow")
    rotations = truth.local_rotations.copy()
    rotations[:, elbow] = rotations[:, elbow] @ axis_angle_to_matrix(
        np.array([np.deg2rad(16.0), 0.0, 0.0])
    )
    off = replace(truth, local_rotations=rotations)
    assert joint_rotation_errors(off, truth)["left_elbow"] == pytest.approx(16.0)
    assert pose_errors(off, truth)["rotation_error_deg"] == pytest.approx(16.0 / len(JUDGED_JOINTS))


def test_exchanged_sides_are_told(truth):
    mirrored = truth.positions.copy()
    for joint, name in enumerate(JOINT_NAMES):
        if name.startswith("left_"):
            other = JOINT_NAMES.index(name.replace("left", "right"))
            mirrored[3, [joint, other]] = mirrored[3, [other, joint]]
    relative = [positions - positions[:, :1] for positions in (mirrored, truth.positions)]
    assert np.flatnonzero(swapped(*relative)).tolist() == [3]


def test_noise_is_jitter_and_slides_planted_feet():
    truth = seen_joints(body().skeleton, standing(12), camera().world_to_camera)
    noisy = truth.positions + np.random.default_rng(0).normal(0.0, 0.01, truth.positions.shape)
    errors = pose_errors(replace(truth, positions=noisy), truth)
    assert errors["jitter_m_s3"] > 5.0 * errors["jitter_truth_m_s3"]
    assert errors["foot_slide_mm_s"] > errors["foot_slide_truth_mm_s"]
