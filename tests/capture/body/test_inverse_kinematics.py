"""Closed-form inverse kinematics against poses that are known."""

from __future__ import annotations

import numpy as np
import pytest

from capture.body.inverse_kinematics import solve_pose, solve_translation
from scene.motion import Pose
from tests.capture.people import JOINT, LANDMARK, body, landmark_positions, up_is_down

POSES = {
    "t pose": {},
    "left elbow bent": {"left_elbow": (0.0, -1.0, 0.0)},
    "right elbow bent": {"right_elbow": (0.0, 1.2, 0.0)},
    "knee lifted": {"left_hip": (-0.9, 0.0, 0.0), "left_knee": (1.2, 0.0, 0.0)},
    "turned away": {"pelvis": (0.0, 3.0, 0.0)},
    "sideways, arms down": {
        "pelvis": (0.0, 1.4, 0.0),
        "left_shoulder": (0.0, 0.0, -1.3),
        "right_shoulder": (0.0, 0.0, 1.3),
    },
    "looking up and left": {"neck": (-0.2, 0.2, 0.0), "head": (-0.2, 0.2, 0.0)},
    "leaning": {"pelvis": (0.0, 0.0, 0.5), "right_hip": (0.0, 0.0, -0.5)},
}


def _angles(turns: dict[str, tuple[float, float, float]]) -> np.ndarray:
    angles = np.zeros((24, 3))
    for name, turn in turns.items():
        angles[JOINT[name]] = turn
    return angles


@pytest.mark.parametrize("name", POSES)
def test_known_poses_are_found(name):
    angles = _angles(POSES[name])
    still = np.zeros(3)
    solved = solve_pose(up_is_down(landmark_positions(body(), Pose(angles, still))))
    skeleton = body().skeleton
    off = (
        skeleton.joint_transforms(solved, still)[:, :3, 3]
        - skeleton.joint_transforms(angles, still)[:, :3, 3]
    )
    assert np.linalg.norm(off, axis=1).max() < 0.05
    assert np.linalg.norm(off, axis=1).mean() < 0.02


def test_angles_do_not_depend_on_size_or_place():
    points = up_is_down(
        landmark_positions(body(), Pose(_angles(POSES["knee lifted"]), np.zeros(3)))
    )
    assert solve_pose(1.3 * points + 4.0) == pytest.approx(solve_pose(points), abs=1e-9)


def test_frames_are_independent_of_their_batch():
    points = np.stack(
        [
            up_is_down(landmark_positions(body(), Pose(_angles(turns), np.zeros(3))))
            for turns in POSES.values()
        ]
    )
    together = solve_pose(points)
    assert together.shape == (len(POSES), 24, 3)
    assert together[3] == pytest.approx(solve_pose(points[3]), abs=1e-12)


def test_unseen_legs_stay_straight_and_unseen_arms_hang():
    points = up_is_down(
        landmark_positions(body(), Pose(_angles(POSES["knee lifted"]), np.zeros(3)))
    )
    visibility = np.ones(33)
    visibility[[LANDMARK["left_knee"], LANDMARK["right_elbow"]]] = 0.0
    solved = solve_pose(points, visibility)
    assert solved[[JOINT["left_hip"], JOINT["left_knee"]]] == pytest.approx(0.0, abs=1e-9)
    assert solved[JOINT["right_shoulder"], 2] == pytest.approx(np.pi / 2, abs=1e-6)


def test_degenerate_landmarks_give_finite_angles():
    assert np.isfinite(solve_pose(np.zeros((33, 3)))).all()


def test_the_translation_reprojects():
    rng = np.random.default_rng(0)
    points, shift = rng.normal(0.0, 0.5, (2, 20, 3)), np.array([[0.3, -0.2, 4.0], [0.0, 0.1, 3.0]])
    intrinsics = np.array([[500.0, 0.0, 320.0], [0.0, 520.0, 240.0], [0.0, 0.0, 1.0]])
    seen = (points + shift[:, None]) @ intrinsics.T
    pixels = seen[..., :2] / seen[..., 2:]
    found = solve_translation(points, pixels, np.ones((2, 20)), intrinsics)
    assert found == pytest.approx(shift, abs=1e-6)


def test_untrusted_landmarks_do_not_pull_the_translation():
    rng = np.random.default_rng(0)
    points, shift = rng.normal(0.0, 0.5, (1, 20, 3)), np.array([[0.3, -0.2, 4.0]])
    pixels = (points + shift)[..., :2] / (points + shift)[..., 2:]
    pixels[:, 0] += 50.0
    weights = np.ones((1, 20))
    weights[:, 0] = 0.0
    assert solve_translation(points, pixels, weights, np.eye(3)) == pytest.approx(shift, abs=1e-6)
