"""Live motion: followed, predicted over short gaps, eased to rest over long ones, on its feet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.live.filter import AT_MOST_S
from scene.errors import InvalidInput
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from services.live.keypoints_packet import KEYPOINTS_BYTES, decode_keypoints, encode_keypoints
from services.live.motion.foot_locking_kernels import bend, level, reach_with
from services.live.motion.live_motion import EASE_S, LiveMotion
from tests.capture.people import JOINT, body, standing
from tests.services.live.people import joints, seen

BEHIND_S = 4000.0
"""Our clock less the camera's."""
FEET = [JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")]
LEFT_ELBOW = JOINT["left_elbow"]


def followed(poses: list[Pose], **how: bool) -> tuple[LiveMotion, list[Pose]]:
    """A live motion that has seen `poses`, and what it showed at each."""
    live, shown = LiveMotion(body().skeleton), []
    for index, pose in enumerate(poses):
        packet = decode_keypoints(encode_keypoints(seen(pose, index, **how)))
        live.update(packet, pose.time_s + BEHIND_S)
        at = live.pose_at(pose.time_s + BEHIND_S)
        assert at is not None
        shown.append(at)
    return live, shown


def at(live: LiveMotion, time_s: float) -> Pose:
    pose = live.pose_at(time_s + BEHIND_S)
    assert pose is not None
    return pose


@pytest.fixture(scope="module")
def waving() -> list[Pose]:
    motion = standing(30)
    return [motion.pose(i) for i in range(30)]


@pytest.fixture(scope="module")
def waved(waving) -> tuple[LiveMotion, list[Pose]]:
    return followed(waving)


def test_nobody_is_shown_before_they_are_seen():
    assert LiveMotion(body().skeleton).pose_at(1.0) is None


def test_the_performer_moves_as_the_person_does(waving, waved):
    _, shown = waved
    for truth, pose in list(zip(waving, shown, strict=True))[10:]:
        # arms as seen, up to the filter's lag; where the person stands is the room's affair
        mine, theirs = joints(pose), joints(truth)
        gap = (mine - mine[0]) - (theirs - theirs[0])
        assert np.linalg.norm(gap, axis=1).mean() < 0.05
    elbows = [pose.joint_angles[LEFT_ELBOW] for pose in shown]
    assert np.ptp(np.linalg.norm(elbows, axis=1)) > 0.4


def test_a_short_gap_is_predicted_and_a_long_one_eased_to_rest(waving, waved):
    live, shown = waved
    end_s = waving[-1].time_s
    turns = [at(live, end_s + gap).joint_angles for gap in (0.0, 0.05, 0.1, AT_MOST_S)]
    steps = np.linalg.norm(np.diff(turns, axis=0)[:, LEFT_ELBOW], axis=1)
    pace = np.linalg.norm(shown[-1].joint_angles - shown[-2].joint_angles, axis=1)[LEFT_ELBOW] * 30
    # it goes on evenly, at no more than the pace at which it was going
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.1)
    assert 0.25 < steps.sum() / (AT_MOST_S * pace) < 1.1
    rest = at(live, end_s + AT_MOST_S + EASE_S)
    away = [
        np.abs(at(live, end_s + AT_MOST_S + share * EASE_S).joint_angles - rest.joint_angles).max()
        for share in (0.0, 0.25, 0.5, 0.75, 1.0)
    ]
    assert away[0] > 0.2
    assert away == sorted(away, reverse=True)
    assert away[-1] == 0.0
    late = at(live, end_s + 60.0)
    np.testing.assert_array_equal(late.joint_angles, rest.joint_angles)
    # arms hang, and they stand on both feet
    places = joints(rest)
    assert places[JOINT["left_wrist"], 1] < places[JOINT["pelvis"], 1] + 0.1
    np.testing.assert_allclose(places[FEET, 1], body().skeleton.rest_joints[FEET, 1], atol=0.01)


def test_nothing_jumps_when_somebody_is_lost_and_seen_again(waving):
    live, _ = followed(waving)
    back_s = waving[-1].time_s + 0.8
    before = at(live, back_s)
    again = replace(seen(waving[5], 99), capture_time_ms=1e3 * back_s)
    live.update(again, back_s + BEHIND_S)
    after = at(live, back_s)
    assert np.abs(after.joint_angles - before.joint_angles).max() < 0.35
    later = at(live, back_s + 0.14)
    assert np.abs(later.joint_angles - before.joint_angles).max() > 0.01


@pytest.mark.parametrize("legs", [True, False])
def test_feet_do_not_slide_while_somebody_stands_and_sways(legs):
    motion, poses = standing(60), []
    for index in range(60):
        angles = motion.joint_angles[index].copy()
        angles[0, 1] += 0.3 * np.sin(index / 8.0)
        angles[JOINT["spine1"], 0] += 0.2 * np.sin(index / 11.0)
        root = np.array([0.03 * np.sin(index / 9.0), 0.0, 0.0])
        poses.append(Pose(angles, root, index / 30.0))
    live, shown = followed(poses, legs=legs)
    gone = at(live, poses[-1].time_s + 5.0)
    feet = np.array([joints(pose)[FEET] for pose in [*shown[5:], gone]])
    assert np.ptp(feet, axis=0).max() < 0.005
    assert np.ptp([joints(pose)[JOINT["left_shoulder"]] for pose in shown], axis=0).max() > 0.03


def test_an_upper_body_stands_upright_on_straight_legs(waving):
    sitting = []
    for pose in waving:
        angles = pose.joint_angles.copy()
        for side in ("left", "right"):
            angles[JOINT[f"{side}_hip"]] = [-1.5, 0.0, 0.0]
            angles[JOINT[f"{side}_knee"]] = [1.5, 0.0, 0.0]
        sitting.append(Pose(angles, pose.root_translation, pose.time_s))
    _, shown = followed(sitting, legs=False)
    rest = body().skeleton.rest_joints
    places = joints(shown[-1])
    np.testing.assert_allclose(places[FEET, 1], rest[FEET, 1], atol=0.02)
    assert places[JOINT["head"], 1] > 0.95 * rest[JOINT["head"], 1]
    assert places[0, 1] > 0.95 * rest[0, 1]


def test_whoever_walks_to_the_side_takes_steps_and_is_followed():
    motion = standing(60)
    poses = [
        Pose(motion.joint_angles[i], np.array([0.01 * i, 0.0, 0.0]), i / 30.0) for i in range(60)
    ]
    _, shown = followed(poses)
    ankles = np.array([joints(pose)[JOINT["left_ankle"]] for pose in shown])
    assert ankles[-1, 0] - ankles[0, 0] > 0.3
    still = np.linalg.norm(np.diff(ankles[:, [0, 2]], axis=0), axis=1) < 1e-3
    assert 0.2 < still.mean() < 0.95  # stance and swing


def test_a_tilted_camera_makes_nobody_lean():
    motion = standing(40)
    tilt = axis_angle_to_matrix(np.array([0.25, 0.0, 0.0]))
    poses = []
    for index in range(40):
        angles = motion.joint_angles[index].copy()
        angles[0] = matrix_to_axis_angle(tilt @ axis_angle_to_matrix(angles[0]))
        poses.append(Pose(angles, np.zeros(3), index / 30.0))
    _, shown = followed(poses)
    places = joints(shown[-1])
    trunk = places[JOINT["neck"]] - places[JOINT["pelvis"]]
    assert abs(trunk[2]) < 0.12 * np.linalg.norm(trunk)


def test_facing_the_camera_is_facing_where_one_is_told_to(waving):
    live = LiveMotion(body().skeleton, yaw_rad=-0.7)
    for index, pose in enumerate(waving[:5]):
        live.update(seen(pose, index), pose.time_s + BEHIND_S)
    forward = axis_angle_to_matrix(at(live, waving[4].time_s).joint_angles[0])[:, 2]
    assert np.arctan2(forward[0], forward[2]) == pytest.approx(-0.7, abs=0.1)


def test_packets_that_tell_no_pose_are_refused_and_change_nothing(waving):
    live, _ = followed(waving[:5])
    now_s = waving[4].time_s
    before = at(live, now_s)
    old = seen(waving[3], 50)
    tiny = replace(seen(waving[6], 51), xy=np.full((33, 2), 0.5))
    hidden = replace(seen(waving[6], 52), visibility=np.zeros(33))
    for packet, words in (
        (old, "capture time must be later than"),
        (tiny, "must be at least 40 px large; got 0"),
        (hidden, "must be of a person; got none"),
    ):
        with pytest.raises(InvalidInput, match=words):
            live.update(packet, now_s + BEHIND_S)
    np.testing.assert_array_equal(at(live, now_s).joint_angles, before.joint_angles)
    live.update(seen(waving[7], 53), waving[7].time_s + BEHIND_S)


def test_it_tells_how_old_the_newest_picture_was(waving):
    live, _ = followed(waving[:2])
    assert live.landmarks_age_ms == 1, "found at once"
    live.update(replace(seen(waving[2], 50), age_ms=72), waving[2].time_s + BEHIND_S)
    assert live.landmarks_age_ms == 72
    assert LiveMotion(body().skeleton).landmarks_age_ms == 0


@given(st.binary(min_size=KEYPOINTS_BYTES - 20, max_size=KEYPOINTS_BYTES - 20))
@settings(max_examples=40)
def test_any_landmarks_give_a_pose_or_are_refused(noise):
    live = LiveMotion(body().skeleton)
    head = encode_keypoints(seen(standing(1).pose(0), 1))[:20]
    try:
        live.update(decode_keypoints(head + noise), 1.0)
    except InvalidInput:
        assert live.pose_at(1.0) is None
    else:
        pose = live.pose_at(1.0)
        assert pose is not None
        assert np.isfinite(joints(pose)).all()


@given(st.tuples(*[st.floats(-0.25, 0.25)] * 2), st.floats(-0.9, -0.3))
def test_a_leg_reaches_what_is_in_reach(aside, down):
    leg = np.array([[0.0, 0.9, 0.0], [0.0, 0.5, 0.02], [0.0, 0.1, 0.0]])
    target = np.array([aside[0], 0.9 + down, aside[1]])
    thigh, shin = bend(leg[0], leg[1], leg[2], np.array([0.0, 0.0, 1.0]), target)
    knee = leg[0] + thigh @ (leg[1] - leg[0])
    ankle = knee + shin @ (leg[2] - leg[1])
    length = np.linalg.norm(np.diff(leg, axis=0), axis=1).sum()
    gap = np.linalg.norm(target - leg[0])
    if gap < 0.999 * length:
        np.testing.assert_allclose(ankle, target, atol=1e-9)
    else:  # stretched towards it
        along = (ankle - leg[0]) @ (target - leg[0]) / gap
        assert along == pytest.approx(0.999 * length, abs=1e-9)


@pytest.mark.parametrize("lowered_m", [0.0, 0.2])
def test_both_feet_come_to_where_they_are_held(lowered_m):
    """Read back by the skeleton's own kinematics; a pelvis that is too high sinks."""
    skeleton, rng = body().skeleton, np.random.default_rng(0)
    local = axis_angle_to_matrix(rng.normal(0.0, 0.15, (24, 3)))
    legs = np.array(
        [
            [JOINT[f"{side}_{part}"] for part in ("hip", "knee", "ankle", "foot")]
            for side in ("left", "right")
        ]
    )
    pelvis = skeleton.rest_joints[0] - [0.0, 0.1, 0.0]
    ankles = skeleton.rest_joints[legs[:, 2]] - [0.0, lowered_m, 0.0]
    turns = axis_angle_to_matrix(rng.normal(0.0, 0.3, (2, 3)))
    arms = local[JOINT["left_elbow"]].copy()
    parents = np.array(skeleton.parents)
    sink = reach_with(local, pelvis, skeleton.rest_joints, parents, legs, ankles, turns)
    assert (sink < -0.05) == (lowered_m > 0.0)
    root = pelvis + np.array([0.0, sink, 0.0]) - skeleton.rest_joints[0]
    found = skeleton.joint_transforms(matrix_to_axis_angle(local), root)[legs[:, 2]]
    np.testing.assert_allclose(found[:, :3, 3], ankles, atol=2e-3)
    np.testing.assert_allclose(found[:, :3, :3], turns, atol=1e-9)
    np.testing.assert_array_equal(local[JOINT["left_elbow"]], arms)


def test_a_level_turn_faces_the_same_way():
    turn = axis_angle_to_matrix(np.array([0.3, 1.1, -0.2]))
    flat = level(turn)
    np.testing.assert_allclose(flat[1], [0.0, 1.0, 0.0], atol=1e-12)
    assert flat[0, 2] / flat[2, 2] == pytest.approx(turn[0, 2] / turn[2, 2])


def test_every_whole_millisecond_is_found_again(waving):
    live = LiveMotion(body().skeleton)
    for number, captured_ms in enumerate((1001.0, 1009.0, 4029.0, 65_599.0, 70_001.0)):
        packet = replace(seen(waving[number], number), capture_time_ms=captured_ms)
        live.update(packet, captured_ms / 1e3)
        found = live.solved(captured_ms % 65_536)
        assert found is not None
        assert found.captured_ms == captured_ms
    assert live.solved(1002.0) is None
