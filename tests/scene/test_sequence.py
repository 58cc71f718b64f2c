"""Sequences, body crops and placements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scene import Body, InvalidInput, Motion, Pose, Sequence, Skeleton, body_crop, placement
from tests.renderer.studio import make_sequence


class NoFrames:
    def __len__(self) -> int:
        return 0

    def camera(self, index):
        raise IndexError(index)

    pose = image = mask = camera


def test_body_crop_grows_the_mask_box_by_its_size():
    mask = np.zeros((100, 80))
    mask[20:60, 30:50] = 0.2
    assert body_crop(mask) == (slice(18, 62), slice(29, 51))


def test_body_crop_stays_inside_the_image():
    assert body_crop(np.ones((10, 10))) == (slice(0, 10), slice(0, 10))
    assert body_crop(np.zeros((10, 10))) is None


def test_a_sequence_needs_a_pose_a_frame():
    body, motion = Body(Skeleton(np.zeros((24, 3)))), Motion.from_poses([Pose.rest()])
    with pytest.raises(InvalidInput, match="one pose a training frame; got 0 frames and 1 poses"):
        Sequence("someone", 30.0, body, NoFrames(), "", motion)


def test_placement_turns_then_moves():
    matrix = placement(np.array([1.0, 0.0, 2.0]), np.pi / 2)
    np.testing.assert_allclose(matrix @ [0.0, 1.0, 1.0, 1.0], [2.0, 1.0, 2.0, 1.0], atol=1e-12)


def test_a_part_has_the_frames_and_poses_that_were_asked_for():
    clip = make_sequence(frames=5)
    part = clip.part([1, 4])
    assert len(part.train) == len(part.motion) == 2
    assert part.train.pose(1).time_s == part.motion.times_s[1] == clip.motion.times_s[4]
    np.testing.assert_array_equal(part.frame(0).image, clip.frame(1).image)
    assert part.data_hash == clip.data_hash
    assert clip.part(range(5)) is clip


def test_frames_of_another_sequence_come_long_after_and_stand_where_they_stood():
    clip, later = make_sequence(frames=4), make_sequence(frames=3)
    taller = Skeleton(later.body.skeleton.rest_joints + np.array([0.0, 0.1, 0.0]))
    later = replace(later, body=later.body.on(taller), data_hash="later")
    both = clip.followed_by(later)
    assert len(both.train) == len(both.motion) == 7
    times = both.motion.times_s
    assert (np.diff(times) > 0.0).all()
    assert times[4] - times[3] > 10.0
    np.testing.assert_allclose(np.diff(times[4:]), np.diff(later.motion.times_s))
    for index, (source, own) in {1: (clip, 1), 5: (later, 1)}.items():
        np.testing.assert_array_equal(both.frame(index).image, source.frame(own).image)
        np.testing.assert_array_equal(both.frame(index).mask, source.frame(own).mask)
        assert both.train.camera(index) is source.train.camera(own)
    pelvis = clip.body.skeleton.rest_joints[0] + both.train.pose(5).root_translation
    np.testing.assert_allclose(pelvis, taller.rest_joints[0] + later.train.pose(1).root_translation)
    assert both.data_hash not in (clip.data_hash, later.data_hash)
    assert clip.followed_by(replace(later, data_hash="other")).data_hash != both.data_hash


def test_a_surface_follows_the_joints_to_other_bone_lengths():
    body = make_sequence(frames=1).body
    longer = Skeleton(1.1 * body.skeleton.rest_joints)
    moved = body.on(longer)
    assert moved.skeleton is longer
    assert moved.rest_vertices is not None
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    shift = longer.rest_joints - body.skeleton.rest_joints
    of_joint = body.blend_weights.argmax(axis=1)
    np.testing.assert_allclose(moved.rest_vertices, body.rest_vertices + shift[of_joint])
    joints_alone = Body(body.skeleton).on(longer)
    assert joints_alone.skeleton is longer
    assert not joints_alone.has_surface
