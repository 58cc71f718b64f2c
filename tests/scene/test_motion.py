"""Motion: reading between poses, resampling, smoothing, brief prediction."""

from __future__ import annotations

import numpy as np
import pytest

from scene import EXPRESSION_COUNT, EXPRESSION_NAMES, InvalidInput, Motion, Pose
from scene.expression import (
    BLEND_SHAPE_COUNT,
    GAZE,
    blend_shape_weights,
    gaze_numbers,
    gaze_of,
    offsets_of_any_version,
    values_of_any_version,
)
from scene.rotations import axis_angle_to_matrix


def turning(frames: int = 5, rate_rad_s: float = 1.0, seconds: float = 1.0) -> Motion:
    times = np.linspace(0.0, seconds, frames)
    poses = []
    for time in times:
        angles = np.zeros((24, 3))
        angles[0, 1] = rate_rad_s * time
        poses.append(Pose(angles, np.array([time, 0.0, 0.0]), float(time)))
    return Motion.from_poses(poses)


def test_reads_between_poses_on_the_arc():
    pose = turning(3).pose_at(0.3)
    assert pose.joint_angles[0, 1] == pytest.approx(0.3)
    np.testing.assert_allclose(pose.root_translation, [0.3, 0.0, 0.0])


@pytest.mark.parametrize(("time", "yaw"), [(-1.0, 0.0), (9.0, 1.0)])
def test_holds_the_end_poses_outside(time, yaw):
    pose = turning().pose_at(time)
    assert pose.joint_angles[0, 1] == pytest.approx(yaw)
    assert pose.time_s == time


def test_shortest_arc_is_taken_across_pi():
    angles = np.zeros((2, 24, 3))
    angles[0, 0, 1], angles[1, 0, 1] = np.pi - 0.1, -np.pi + 0.1
    motion = Motion(np.array([0.0, 1.0]), angles, np.zeros((2, 3)), np.ones((2, 24)))
    middle = axis_angle_to_matrix(motion.pose_at(0.5).joint_angles[0])
    np.testing.assert_allclose(middle, np.diag([-1.0, 1.0, -1.0]), atol=1e-9)


def test_resampling_keeps_rate_range_and_path():
    motion = turning(5).resampled(30.0)
    assert len(motion) == 31
    np.testing.assert_allclose(np.diff(motion.times_s), 1 / 30)
    np.testing.assert_allclose(motion.joint_angles[:, 0, 1], motion.times_s, atol=1e-9)


def test_extrapolates_at_the_last_pace_then_stops():
    motion = turning(5)
    assert motion.extrapolated(1.1).joint_angles[0, 1] == pytest.approx(1.1)
    held = motion.extrapolated(5.0)
    assert held.joint_angles[0, 1] == pytest.approx(1.15)
    np.testing.assert_allclose(held.root_translation, [1.15, 0.0, 0.0])


def test_smoothing_keeps_steady_motion_and_removes_noise():
    rng = np.random.default_rng(0)
    clean = turning(101, seconds=10.0)
    noisy = Motion(
        clean.times_s,
        clean.joint_angles + 0.1 * rng.normal(size=clean.joint_angles.shape),
        clean.root_translation,
        clean.confidence,
    )
    inner = slice(15, -15)
    steady = clean.smoothed(0.3).joint_angles[inner, 5]
    np.testing.assert_allclose(steady, 0.0, atol=1e-9)
    before = np.abs(noisy.joint_angles[inner, 5]).mean()
    after = np.abs(noisy.smoothed(0.3).joint_angles[inner, 5]).mean()
    assert after < 0.5 * before


def test_smoothing_trusts_confidence():
    motion = turning(11)
    angles = motion.joint_angles.copy()
    angles[5, 3] = [2.0, 0.0, 0.0]
    confidence = motion.confidence.copy()
    confidence[5, 3] = 0.0
    spoiled = Motion(motion.times_s, angles, motion.root_translation, confidence)
    assert np.abs(spoiled.smoothed(0.2).joint_angles[5, 3]).max() < 0.01


def talking() -> Motion:
    """Two poses a second apart: the jaw opens, the smile fades."""
    unit = np.eye(EXPRESSION_COUNT)
    shut, opened = unit[EXPRESSION_NAMES.index("smile")], unit[0]
    poses = [
        Pose(np.zeros((24, 3)), np.zeros(3), float(i), e) for i, e in enumerate([shut, opened])
    ]
    return Motion.from_poses(poses)


def test_faces_and_hands_are_at_rest_unless_told():
    assert not Pose.rest().expression.any()
    assert turning(3).expressions.shape == (3, EXPRESSION_COUNT)
    assert not turning(3).pose_at(0.4).expression.any()


def test_expressions_are_blended_between_frames():
    motion = talking()
    np.testing.assert_allclose(motion.pose_at(0.25).expression[[0, 4]], [0.25, 0.75])
    resampled = motion.resampled(4.0)
    np.testing.assert_allclose(resampled.expressions[:, 0], [0.0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_array_equal(motion.pose_at(9.0).expression, motion.expressions[1])


def test_expressions_are_never_predicted_past_their_ends():
    ahead = talking().extrapolated(1.1).expression
    assert ahead[0] == 1.0
    assert ahead[4] == 0.0


def test_smoothing_spreads_an_expression():
    shown = talking().smoothed(1.0).expressions[:, 0]
    np.testing.assert_allclose(shown, [0.3775, 0.6225], atol=1e-4)  # exp(-1/2) beside 1


def test_a_finger_half_bent_has_all_of_its_in_between():
    expression = np.zeros(EXPRESSION_COUNT)
    expression[0] = 0.5  # the jaw's way is a straight line
    curl = EXPRESSION_NAMES.index("right_little_curl")
    expression[curl] = 0.5
    weights = blend_shape_weights(expression)
    assert len(weights) == BLEND_SHAPE_COUNT
    np.testing.assert_array_equal(np.flatnonzero(weights), [0, curl, BLEND_SHAPE_COUNT - 1])
    np.testing.assert_allclose(weights[[0, curl, -1]], [0.5, 0.5, 1.0])
    expression[curl] = 1.0
    assert blend_shape_weights(expression)[-1] == 0.0


@pytest.mark.parametrize("stored", [7, 15])
def test_values_of_any_version_have_all_numbers(stored: int):
    read = values_of_any_version(np.arange(1.0, stored + 1.0))
    assert read.shape == (EXPRESSION_COUNT,)
    assert read[:5].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert not read[GAZE].any()
    assert read[-5:].tolist() == ([7.0] * 5 if stored == 7 else [11.0, 12.0, 13.0, 14.0, 15.0])


def test_a_gaze_comes_back_from_its_numbers():
    gaze = np.array([0.2, -0.45, 0.0, 2.0])
    expressions = np.zeros((4, EXPRESSION_COUNT))
    expressions[:, GAZE] = gaze_numbers(gaze)
    np.testing.assert_allclose(gaze_of(expressions), np.clip(gaze, -0.5, 0.5))


@pytest.mark.parametrize("stored", [7, 15, 25, 27])
def test_offsets_of_any_version_have_all_blend_shapes(stored: int):
    offsets = np.ones((4, stored, 3))
    read = offsets_of_any_version(offsets, axis=1)
    assert read.shape == (4, BLEND_SHAPE_COUNT, 3)
    numbers = 17 if stored == 27 else min(stored, 15)
    np.testing.assert_allclose(read[:, :EXPRESSION_COUNT].sum(), 4 * numbers * 3)
    assert read[:, GAZE].any() == (stored == 27)
    assert read[:, EXPRESSION_COUNT:].any() == (stored >= 25)


@pytest.mark.usefixtures("unchecked_annotations")
def test_an_expression_has_its_seventeen_numbers():
    with pytest.raises(InvalidInput, match=r"expression must be 17; got"):
        Pose(np.zeros((24, 3)), np.zeros(3), 0.0, np.zeros(7))
    with pytest.raises(InvalidInput, match=r"expressions must be 2 x 17; got"):
        Motion(
            np.arange(2.0),
            np.zeros((2, 24, 3)),
            np.zeros((2, 3)),
            np.ones((2, 24)),
            np.zeros((1, 17)),
        )


def test_times_must_increase():
    with pytest.raises(InvalidInput, match=r"times_s must increase; got 0\.0 at index 1"):
        Motion(np.zeros(2), np.zeros((2, 24, 3)), np.zeros((2, 3)), np.ones((2, 24)))


def test_a_motion_needs_a_pose():
    with pytest.raises(InvalidInput, match="at least one pose; got none"):
        Motion.from_poses([])
