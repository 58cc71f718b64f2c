"""A clip whose joints miss its masks is refused before training, with a picture that shows it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from capture.errors import CaptureError
from capture.pose_check import joints_on_mask, require_poses_on_mask
from scene import Motion, Pose, Sequence
from scene.sequence import Frame
from tests.renderer.field.performer import Frames, body, sequence, view


def _clip(shift_m: float = 0.0, bottom_px: int | None = None) -> Sequence:
    """Solid silhouettes; poses that stand `shift_m` beside them; pictures cut off below."""
    clip = sequence()
    frames = []
    for index in range(len(clip.train)):
        moment = clip.train.pose(index)
        pixels, _ = view(size=96).project(body().posed_vertices(moment))
        mask = np.zeros((96, 96), np.uint8)
        column, row = np.floor(pixels).astype(int).T
        mask[row, column] = 1
        mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
        solid = mask[:bottom_px].astype(np.float32)
        camera = view(size=96).cropped(0, 0, 96, len(solid))
        place = moment.root_translation + np.array([shift_m, 0.0, 0.0])
        beside = Pose(moment.joint_angles, place, 0.1 * index)
        frames.append(Frame(np.repeat(solid[..., None], 3, axis=2), solid, camera, beside))
    motion = Motion.from_poses([frame.pose for frame in frames])
    return replace(clip, train=Frames(frames), motion=motion)


def test_right_poses_pass_and_are_drawn(tmp_path):
    clip = _clip()
    assert joints_on_mask(clip) > 0.9
    require_poses_on_mask(clip, tmp_path / "poses.png")
    picture = cv2.imread(str(tmp_path / "poses.png"))
    assert picture is not None
    assert picture.shape == (320, 4 * 320, 3)
    assert picture.std() > 10.0


def test_joints_out_of_the_picture_are_nobodys_fault():
    assert joints_on_mask(_clip(bottom_px=50)) > 0.9


@pytest.mark.parametrize(("shift_m", "share"), [(0.6, r"\d+%"), (50.0, "0%")])
def test_poses_beside_the_person_are_refused_with_the_picture(tmp_path, shift_m, share):
    with pytest.raises(CaptureError, match=rf"got {share} of those in sight.*look at .*poses\.png"):
        require_poses_on_mask(_clip(shift_m), tmp_path / "poses.png")
    assert (tmp_path / "poses.png").exists()
