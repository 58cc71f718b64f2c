"""What steps look at: people who were filmed from one side are looked at from beside, too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats
from renderer.splats.training.step_views import StepViews, turn_rad
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View, read_views
from scene.motion import Motion, Pose
from scene.sequence import PoseTrust, Sequence
from scene.skeleton import HEAD, JOINT_COUNT
from tests.renderer.studio import make_sequence

SETTINGS = SplatSettings(count=400, beside_share=0.5)
CHEST = 9


def turning(body_deg: float, head_deg: float, frames: int = 6) -> Motion:
    """The body turns by `body_deg` in a clip, the head by `head_deg` more."""
    poses = []
    for frame in range(frames):
        angles = np.zeros((JOINT_COUNT, 3))
        angles[0, 1] = np.radians(body_deg) * frame / (frames - 1)
        angles[HEAD, 1] = np.radians(head_deg) * frame / (frames - 1)
        poses.append(Pose(angles, np.zeros(3), frame / 10.0))
    return Motion.from_poses(poses)


def clip(
    body_deg: float, head_deg: float = 0.0, trust: PoseTrust = PoseTrust.ESTIMATED
) -> Sequence:
    return make_sequence(trust=trust, motion=turning(body_deg, head_deg))


def looks(views: StepViews, sequence: Sequence, fraction: float, count: int) -> Iterator[View]:
    """What `count` steps look at of the first frame."""
    first = first_splats(sequence, SETTINGS, np.random.default_rng(0))
    skeleton, expressions = sequence.body.skeleton, sequence.motion.expressions
    splats = TrainedSplats(first, skeleton, expressions, SETTINGS)
    pose, chance = sequence.motion.pose(0), np.random.default_rng(0)
    posed = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    for _ in range(count):
        yield views.drawn(0, splats, posed.astype(np.float32), fraction, chance)


def turned_cameras(sequence: Sequence, fraction: float, count: int = 60) -> np.ndarray:
    """How far from the frame's own each of `count` steps' cameras stood, degrees."""
    views = StepViews(read_views(sequence.train), sequence, SETTINGS)
    found = []
    for view in looks(views, sequence, fraction, count):
        cosine = view.window.rotation[2] @ views.whole[0].window.rotation[2]
        found.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.array(found)


def test_how_far_a_part_turns():
    motion = clip(100.0, 30.0)
    assert np.degrees(turn_rad(motion, CHEST)) == pytest.approx(90.0, abs=1.0)
    assert np.degrees(turn_rad(motion, HEAD)) == pytest.approx(117.0, abs=1.0)


def test_who_turns_once_has_turned_further_than_who_turns_half():
    assert turn_rad(clip(360.0), CHEST) > np.radians(300.0)


def test_one_sided_clips_are_looked_at_from_beside():
    angles = turned_cameras(clip(5.0), 0.5)
    beside = angles > 1.0
    assert 0.3 < beside.mean() < 0.7
    low, high = SETTINGS.beside_deg
    # cameras look down a little: turned about the vertical, their axes are a little nearer
    assert angles[beside].min() > 0.9 * low
    assert angles[beside].max() <= high
    assert np.ptp(angles[beside]) > 20.0


def test_a_head_that_turns_does_not_tell_how_the_trunk_looks_from_beside():
    assert (turned_cameras(clip(5.0, 90.0), 0.5) > 1.0).any()


@pytest.mark.parametrize(
    ("sequence", "fraction"),
    [
        (clip(180.0), 0.5),
        (clip(5.0, trust=PoseTrust.EXACT), 0.5),
        (clip(5.0, trust=PoseTrust.GIVEN), 0.5),
        (clip(5.0), 0.1),
    ],
    ids=["who turns", "exact poses", "given poses", "early on"],
)
def test_others_are_not(sequence: Sequence, fraction: float):
    assert turned_cameras(sequence, fraction).max() < 1e-3


TURNING = clip(180.0)
"""Whom no step looks at from beside."""


def registering(sequence: Sequence = TURNING) -> tuple[StepViews, list[View]]:
    filmed = read_views(sequence.train)
    return StepViews(filmed, sequence, SETTINGS), filmed


def drawn(views: StepViews) -> np.ndarray:
    """The first frame as steps look at it."""
    (view,) = looks(views, TURNING, 0.5, 1)
    return view.rgba


def pairs(filmed: list[View], shift_px: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """A model's pictures, `shift_px` to the left of each frame, and these."""
    for view in filmed:
        truth = view.rgba.astype(np.float32) / 255.0
        yield np.roll(truth, -shift_px, axis=1), truth


def test_frames_are_registered_twice_where_poses_are_estimated():
    views, filmed = registering()
    assert not views.should_register(0.49)
    assert views.should_register(0.5)
    views.register(pairs(filmed, 1))
    assert not views.should_register(0.74)
    assert views.should_register(0.75)
    views.register(pairs(filmed, 1))
    assert not views.should_register(1.0)
    for trust in (PoseTrust.EXACT, PoseTrust.GIVEN):
        assert not registering(clip(180.0, trust=trust))[0].should_register(1.0)


def test_steps_look_at_registered_frames_and_all_else_at_those_that_were_filmed():
    views, filmed = registering()
    before = drawn(views)
    np.testing.assert_array_equal(before, filmed[0].rgba)
    views.register(pairs(filmed, 1))
    moved = drawn(views)
    assert (moved != before).any()
    np.testing.assert_array_equal(views.whole[0].rgba, filmed[0].rgba)
    again, _ = registering()
    again.restore(views.state())
    np.testing.assert_array_equal(drawn(again), moved)
    assert not again.should_register(0.6)
    again.restore(registering()[0].state())
    np.testing.assert_array_equal(drawn(again), before)
    assert again.should_register(0.6)
