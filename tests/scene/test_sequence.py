"""Sequences, body crops and placements."""

from __future__ import annotations

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
