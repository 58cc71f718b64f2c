"""Overlays: drawn where the person is, and videos that can be read again."""

from __future__ import annotations

import numpy as np
import pytest

from capture.overlay import draw_overlay, project_surface, surface_mask, write_overlay_video
from capture.sources.video import read_video
from capture.storage import open_sequence, write_sequence
from scene.body import Body
from scene.sequence import Frame, PoseTrust
from scene.skeleton import Skeleton
from tests.capture.people import body, camera, seen_by, standing


@pytest.fixture(scope="module")
def frame() -> Frame:
    pose = standing(4).pose(1)
    person = seen_by(camera(), body(), pose)
    grey = np.full((256, 256, 3), 0.5, dtype=np.float32)
    return Frame(grey, person.mask, camera(), pose)


def test_the_overlay_changes_the_person_not_the_corners(frame):
    drawn = draw_overlay(frame, body())
    changed = (drawn != 127).any(axis=2)
    assert changed[frame.mask > 0.5].mean() > 0.1
    assert not changed[:10].any()
    assert not changed[:, :10].any()


def test_left_is_orange_and_right_is_blue(frame):
    drawn = draw_overlay(frame, body()).astype(int)
    warm = np.nonzero((drawn[..., 0] - drawn[..., 2]) > 150)[1].mean()
    cold = np.nonzero((drawn[..., 2] - drawn[..., 0]) > 150)[1].mean()
    assert warm > 128 > cold  # a person who faces the camera has their left at the right


def test_the_surface_covers_the_true_mask(frame):
    covered = surface_mask(frame, body())
    assert covered is not None
    assert (covered == frame.mask).all()


def test_small_pictures_show_the_surface_as_large_as_large_ones():
    """A pixel whose corner alone is touched is not covered."""
    pose = standing(1).pose(0)
    shares = [project_surface(camera(size), body(), pose).mean() for size in (256, 1024)]
    assert shares[0] == pytest.approx(shares[1], rel=0.03)


def test_a_body_of_joints_alone_still_has_its_skeleton(frame):
    bones = Body(Skeleton(body().skeleton.rest_joints))
    assert surface_mask(frame, bones) is None
    assert (draw_overlay(frame, bones) != 127).any()


def test_the_overlay_video_has_every_frame(frame, tmp_path):
    motion = standing(5)
    frames = [Frame(frame.image, frame.mask, frame.camera, motion.pose(i)) for i in range(5)]
    write_sequence(
        tmp_path / "seq",
        person="p",
        frames_per_second=10.0,
        body=body(),
        train=frames,
        source="test",
        pose_trust=PoseTrust.EXACT,
    )
    path = tmp_path / "overlay.mp4"
    write_overlay_video(open_sequence(tmp_path / "seq"), path)
    clip = read_video(path)
    assert len(clip.images) == 5
    assert clip.frames_per_second == pytest.approx(10.0)


def test_mask_and_body_have_outlines_of_their_own(frame):
    moved = Frame(frame.image, np.roll(frame.mask, 20, axis=1), frame.camera, frame.pose)
    drawn = draw_overlay(moved, body()).astype(int)
    green = (drawn[..., 1] > 200) & (drawn[..., 0] < 150)
    magenta = (drawn[..., 0] > 200) & (drawn[..., 1] < 120) & (drawn[..., 2] > 180)
    apart = np.nonzero(magenta)[1].mean() - np.nonzero(green)[1].mean()
    assert apart == pytest.approx(20.0, abs=4.0)
