"""Rooms: endless motion without jumps, people on their spot, facing the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scene import Pose
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import HEAD
from services.arrangement import place
from services.live.room import (
    MeetingPerformer,
    Room,
    eye_height,
    facing_yaw,
    in_place,
    ping_pong_pose,
)
from services.live.streaming.view_track import frame_size
from tests.renderer.studio import make_model, make_motion


def test_motion_goes_to_and_fro_without_a_jump():
    motion = make_motion(20)
    times = np.arange(0.0, 3.0 * motion.duration_s, 0.01)
    poses = np.array([ping_pong_pose(motion, float(t)).joint_angles[9, 0] for t in times])
    pace = np.abs(np.diff(motion.joint_angles[:, 9, 0])).max() / 0.1
    assert np.abs(np.diff(poses)).max() <= 1.01 * pace * 0.01
    ends = [ping_pong_pose(motion, motion.duration_s + d).joint_angles for d in (-0.05, 0.05)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


def test_one_pose_stands_still():
    assert (
        ping_pong_pose(make_motion(1), 99.0).joint_angles == make_motion(1).joint_angles[0]
    ).all()


def test_a_walker_stays_on_the_spot_but_may_jump():
    pose = in_place(Pose(np.zeros((24, 3)), np.array([3.0, 0.2, -1.0])))
    np.testing.assert_array_equal(pose.root_translation, [0.0, 0.2, 0.0])


def test_facing_yaw_turns_the_clip_to_the_front():
    motion = make_motion(8)
    motion.joint_angles[:, 0] = [0.0, 0.7, 0.0]
    assert facing_yaw(motion) == pytest.approx(-0.7)


def test_whoever_was_recorded_turned_away_faces_the_others_all_the_same():
    model = make_model(50)
    model.motion.joint_angles[:, 0] = [0.0, 2.5, 0.0]
    one = MeetingPerformer.at_place("a", "Ada", model, 1)
    assert one.placed.facing_rad == pytest.approx(place(1)[2])
    (shown,) = Room("m", (one,)).scene_at(0.0).performers
    turned = shown.placement[:3, :3] @ axis_angle_to_matrix(shown.pose.joint_angles[0])
    forward = np.array([np.sin(one.placed.facing_rad), 0.0, np.cos(one.placed.facing_rad)])
    np.testing.assert_allclose(turned[:, 2], forward, atol=1e-6)


def test_eyes_of_whoever_sits_are_as_low_as_they_sit():
    skeleton, motion = make_model(50).skeleton, make_motion(8)
    standing = eye_height(skeleton, motion)
    assert standing == pytest.approx(skeleton.rest_joints[HEAD, 1] + 0.05, abs=0.05)
    motion.root_translation[:, 1] -= 0.4
    assert eye_height(skeleton, motion) == pytest.approx(standing - 0.4)


def test_the_first_view_sees_everybody():
    cast = tuple(
        MeetingPerformer.at_place(str(number), "x", make_model(50), number) for number in range(4)
    )
    room = Room("m", cast)
    camera = room.initial_camera(256, 256)
    for member in cast:
        pixel, depth = camera.project(np.add(member.position, (0.0, 0.8, 0.0)))
        assert depth > 0
        assert (pixel > 0).all()
        assert (pixel < 256).all()
    assert len(room.scene_at(0.3).performers) == 4


@pytest.mark.parametrize(
    ("asked", "given"),
    [((512, 512), (512, 512)), ((1000, 500), (992, 496)), ((4000, 2000), (1024, 512)),
     ((0, 0), (512, 512)), ((20, 20), (128, 128))],
)  # fmt: skip
def test_frame_sizes_are_whole_macroblocks_within_bounds(asked, given):
    assert frame_size(*asked) == given


def test_a_viewer_may_see_only_what_was_filmed():
    model = make_model(300)
    model = replace(model, seen=model.parameters[:, 2] > 0.0)
    room = Room("m", (MeetingPerformer("a", "Ada", model, make_motion(4), (0.0, 0.0, 0.0), 0.0),))
    (whole,) = room.scene_at(0.0).performers
    (alone,) = room.scene_at(0.0, hide_unseen=True).performers
    assert whole.model is model
    assert alone.model is model.filmed_parts()
    assert alone.model is not model
