"""Errors of frames that are watched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.storage import open_sequence
from capture.studio import make_sequence as make_studio_sequence
from renderer.splats.settings import SplatSettings
from renderer.splats.training.trainer import SplatTrainer
from renderer.splats.training.watched_frames import Errors, WatchedFrames
from tests.renderer.studio import make_sequence


def errors(face: float, lpips: float, body: float = 1e-3, apart: float = 0.0) -> Errors:
    return Errors({"body": body, "face": face}, {"face": lpips}, apart)


def test_a_face_alone_can_be_too_bad():
    assert errors(1e-3, 0.05).as_good_as(errors(1e-3, 0.05))
    assert not errors(1.1e-3, 0.05).as_good_as(errors(1e-3, 0.05))
    assert not errors(1e-3, 0.055).as_good_as(errors(1e-3, 0.05))
    assert not errors(1e-3, 0.05, body=1.2e-3).as_good_as(errors(1e-3, 0.05))


def test_what_nobody_sees_does_not_count():
    assert errors(3e-6, 0.0015).as_good_as(errors(1e-6, 0.001))
    assert errors(3e-6, 0.0015).lost(errors(1e-6, 0.001)) == {
        "lost_db": {"body": 0.0, "face": 4.771},
        "lpips": {"face": [0.001, 0.0015]},
    }


def test_who_looks_another_from_beside_is_not_as_good():
    assert errors(1e-3, 0.05, apart=0.01).as_good_as(errors(1e-3, 0.05))
    assert not errors(1e-3, 0.05, apart=0.012).as_good_as(errors(1e-3, 0.05))


def test_pictures_from_beside_are_of_somebody_turned_to_either_side():
    clip = make_sequence(frames=20)
    trainer = SplatTrainer(clip, SplatSettings(count=400, most=400), 0)
    for step in range(20):
        trainer.learn(step / 200.0)
    model = trainer.model_so_far()
    for frame, turn_rad, picture in zip(
        (2, 9), (0.26, -0.26), WatchedFrames(trainer, (2, 5, 9)).from_beside(), strict=True
    ):
        pose = model.motion.pose(frame)
        angles = pose.joint_angles.copy()
        angles[0, 1] += turn_rad  # the box stands upright
        expected = model.render(clip.train.camera(frame), replace(pose, joint_angles=angles))
        # of the frame's columns those about the person are drawn
        width = picture.shape[1]
        columns = [expected[:, left:][:, :width] for left in range(expected.shape[1] - width + 1)]
        assert min(np.abs(picture - part).max() for part in columns) < 0.02


def test_a_model_is_no_distance_from_itself_and_some_from_another(tmp_path: Path):
    make_studio_sequence(tmp_path / "clip", frames=4, size=96, test_cameras=1)
    clip = open_sequence(tmp_path / "clip")
    trainer = SplatTrainer(clip, SplatSettings(count=400, most=400), 0)
    watched = WatchedFrames(trainer, (0, 2))
    itself = watched.from_beside()
    assert watched.errors().apart == watched.errors(itself).apart == 0.0
    for step in range(20):
        trainer.learn(step / 200.0)
    assert watched.errors(itself).apart > 0.01


def test_errors_fall_as_training_goes_on_and_regions_not_shown_are_not_judged():
    trainer = SplatTrainer(make_sequence(frames=20), SplatSettings(count=400, most=400), 0)
    for step in range(20):
        trainer.learn(step / 200.0)
    watched = WatchedFrames(trainer, (3, 12))
    before = watched.errors()
    for step in range(20, 120):
        trainer.learn(step / 200.0)
    after = watched.errors()
    # the box has neither head nor hands, and is too narrow for LPIPS
    assert set(after.squared) == {"body"}
    assert after.squared["body"] < 0.7 * before.squared["body"]


def test_light_is_that_which_reaches_the_frames():
    trainer = SplatTrainer(make_sequence(frames=20), SplatSettings(count=400, most=400), 0)
    light = WatchedFrames(trainer, (0,)).light()
    alpha = trainer.drawing.pictures(0)[0][..., 3]
    assert light.sum() == pytest.approx(alpha.sum(), rel=1e-2)
    behind = trainer.splats.first.normals[:, 2] < -0.9
    facing = trainer.splats.first.normals[:, 2] > 0.9
    assert light[facing].mean() > 5.0 * light[behind].mean()
