"""The live solver: known people are found again, frame by frame, and errors mend themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from capture.live.filter import AT_MOST_S, PoseFilter, Smoothing
from capture.live.solver import LiveSolver
from scene.arrays import Array
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix
from tests.capture.people import (
    JOINT,
    LANDMARK,
    body,
    camera,
    landmark_positions,
    seen_by,
    standing,
)

FRAMES = 24
HAND = ("wrist", "pinky", "index", "thumb")


@pytest.fixture(scope="module")
def motion() -> Motion:
    return standing(FRAMES, turn_rad=0.8)


@pytest.fixture(scope="module")
def people(motion):
    return [seen_by(camera(), body(), motion.pose(i)) for i in range(FRAMES)]


def joints(pose: Pose) -> Array:
    skeleton = body().skeleton
    return skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[:, :3, 3]


def error_m(pose: Pose, truth: Pose) -> float:
    return float(np.linalg.norm(joints(pose) - joints(truth), axis=1).mean())


def test_perfect_landmarks_give_back_the_pose(motion, people):
    solver = LiveSolver(body(), camera(), smoothing=None)
    for index, person in enumerate(people):
        pose = solver.step(person, float(motion.times_s[index]))
        assert error_m(pose, motion.pose(index)) < 0.01
        pixels, _ = camera().project(landmark_positions(body(), pose))
        assert np.linalg.norm(pixels - person.pixels, axis=1).mean() < 0.3


def test_the_picture_corrects_the_estimators_depth(motion, people):
    """3D landmarks that are 6 cm wrong: the steps on the picture take most of it away."""
    rng = np.random.default_rng(0)
    pose, person = motion.pose(5), people[5]
    wrong = replace(person, world=person.world + rng.normal(0.0, 0.06, (33, 3)))
    found = LiveSolver(body(), camera(), smoothing=None).step(wrong, 0.0)
    off, _ = camera().project(landmark_positions(body(), found))
    assert np.linalg.norm(off - person.pixels, axis=1).mean() < 0.5
    assert error_m(found, pose) < 0.04


def test_any_camera_and_its_distortion_will_do(motion):
    turn = axis_angle_to_matrix(np.array([0.0, 0.7, 0.0]))
    view = camera()
    moved = Camera(
        view.intrinsics,
        view.world_to_camera,
        view.width,
        view.height,
        np.array([-0.15, 0.03, 0.001, -0.002, 0.0]),
    )
    tilted = Camera(
        view.intrinsics,
        np.concatenate(
            [view.rotation @ turn, (view.rotation @ [0.2, 0.0, 0.3] + view.translation)[:, None]],
            axis=1,
        ),
        view.width,
        view.height,
    )
    pose = motion.pose(3)
    for one in (moved, tilted):
        found = LiveSolver(body(), one, smoothing=None).step(seen_by(one, body(), pose), 0.0)
        assert error_m(found, pose) < 0.008


def test_a_lost_pose_is_found_again_from_the_frame_itself(motion, people):
    solver = LiveSolver(body(), camera(), smoothing=None)
    for index in range(6):
        solver.step(people[index], float(motion.times_s[index]))
    away = standing(1).pose(0)
    angles = away.joint_angles.copy()
    angles[0] = [0.0, 2.6, 0.0]  # of a sudden they stand with their back to the camera
    turned = Pose(angles, away.root_translation)
    found = solver.step(seen_by(camera(), body(), turned), float(motion.times_s[6]))
    assert error_m(found, turned) < 0.02


def test_legs_that_nobody_sees_hang_at_rest(people):
    person = people[0]
    visibility = person.visibility.copy()
    for name, index in LANDMARK.items():
        if any(part in name for part in ("knee", "ankle", "heel", "foot")):
            visibility[index] = 0.0
    found = LiveSolver(body(), camera()).step(replace(person, visibility=visibility), 0.0)
    for name in ("left_knee", "right_knee", "left_hip", "right_hip"):
        assert np.abs(found.joint_angles[JOINT[name]]).max() < 0.1


def test_a_forearm_that_leaves_the_picture_does_not_reach_forward():
    """The estimator puts a hand below the picture just inside it: the forearm seems short."""
    angles = standing(1).pose(0).joint_angles.copy()
    for side, sign in (("left", -1.0), ("right", 1.0)):
        angles[JOINT[f"{side}_shoulder"]] = [0.0, 0.0, sign * 1.2]
        angles[JOINT[f"{side}_elbow"]] = 0.0
    pose = Pose(angles, standing(1).pose(0).root_translation)
    whole = seen_by(camera(), body(), pose)
    elbow, wrist = (whole.pixels[LANDMARK[f"left_{part}"], 1] for part in ("elbow", "wrist"))
    cut = round(0.7 * elbow + 0.3 * wrist)
    pixels = whole.pixels.copy()
    hands = [LANDMARK[f"{side}_{part}"] for side in ("left", "right") for part in HAND]
    pixels[hands, 1] = np.minimum(pixels[hands, 1], cut - 2.0)
    view = replace(camera(), height=cut)
    found = LiveSolver(body(), view, smoothing=None).step(replace(whole, pixels=pixels), 0.0)
    for side in ("left", "right"):
        at, end = JOINT[f"{side}_elbow"], JOINT[f"{side}_wrist"]
        forearms = [joints(one)[end] - joints(one)[at] for one in (found, pose)]
        one, true = (forearm / np.linalg.norm(forearm) for forearm in forearms)
        assert np.degrees(np.arccos(one @ true)) < 10.0


def test_smoothing_takes_the_tremble_and_keeps_up(motion, people):
    rng = np.random.default_rng(1)
    noisy = [replace(p, pixels=p.pixels + rng.normal(0.0, 1.5, (33, 2))) for p in people]
    shakes, errors = [], []
    for smoothing in (None, Smoothing()):
        solver = LiveSolver(body(), camera(), smoothing=smoothing)
        poses = [solver.step(p, float(t)) for p, t in zip(noisy, motion.times_s, strict=True)]
        places = np.stack([joints(pose) for pose in poses])
        shakes.append(np.abs(np.diff(places, 2, axis=0)).mean())
        errors.append(np.mean([error_m(p, motion.pose(i)) for i, p in enumerate(poses)]))
    assert shakes[1] < 0.6 * shakes[0]
    assert errors[1] < 1.5 * errors[0]


def test_a_late_pose_is_moved_on():
    steady = standing(40, turn_rad=2.0)
    people = [seen_by(camera(), body(), steady.pose(i)) for i in range(30)]
    late_s = 0.1
    solvers = [LiveSolver(body(), camera(), latency_s=ahead) for ahead in (0.0, late_s)]
    errors: list[list[float]] = [[], []]
    for index, person in enumerate(people):
        time_s = float(steady.times_s[index])
        for solver, off in zip(solvers, errors, strict=True):
            pose = solver.step(person, time_s)
            off.append(error_m(pose, steady.pose_at(time_s + late_s)))
    assert np.mean(errors[1][10:]) < 0.6 * np.mean(errors[0][10:])


def test_a_lost_frame_is_bridged_but_not_for_long(motion, people):
    solver = LiveSolver(body(), camera())
    for index in range(10):
        last = solver.step(people[index], float(motion.times_s[index]))
    soon = solver.predict(last.time_s + 1 / 30)
    assert error_m(soon, motion.pose(10)) < 0.03
    late, later = (solver.predict(last.time_s + AT_MOST_S + more) for more in (0.5, 5.0))
    np.testing.assert_array_equal(late.joint_angles, later.joint_angles)


def test_landmarks_lie_on_another_body_too():
    from capture.body.landmarks import landmarks_on, load_body_landmarks
    from capture.body.model import load_body_model

    shape = np.array([0.1, -0.1, 0.2, 0.1, 0.0])
    other = load_body_model().body(shape)
    landmarks, _ = landmarks_on(other)
    model = load_body_landmarks()
    wanted = model.rest + model.directions @ shape
    gap = landmarks - wanted
    np.testing.assert_allclose(gap, np.broadcast_to(gap[0], gap.shape), atol=1e-3)  # the floor's


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"latency_s": -0.1}, "latency_s must be between 0 and 10; got -0.1"),
        ({"latency_s": float("nan")}, "latency_s must be between 0 and 10; got nan"),
    ],
)
def test_senseless_latencies_are_refused(change, message):
    with pytest.raises(InvalidInput, match=message):
        LiveSolver(body(), camera(), **change)


def test_time_moves_on_and_somebody_is_seen(people):
    solver = LiveSolver(body(), camera(), smoothing=None)
    solver.step(people[0], 1.0)
    with pytest.raises(InvalidInput, match=r"time_s must be later than 1\.0; got 1\.0"):
        solver.step(people[1], 1.0)
    hidden = replace(people[1], visibility=np.zeros(33))
    with pytest.raises(InvalidInput, match="must show something inside the picture"):
        solver.step(hidden, 2.0)
    with pytest.raises(InvalidInput, match="predict must have a smoothing"):
        solver.predict(2.0)


def test_the_filter_follows_a_constant_turn():
    turning = PoseFilter(Smoothing())
    pace = np.zeros((24, 3))
    pace[0, 1], pace[18, 1] = 1.0, -2.0
    for index in range(60):
        turning.add(axis_angle_to_matrix(pace * index / 30), np.zeros(3), index / 30)
    now, ahead = turning.pose(59 / 30), turning.pose(59 / 30 + 0.1)
    np.testing.assert_allclose(ahead.joint_angles - now.joint_angles, 0.1 * pace, atol=0.01)
