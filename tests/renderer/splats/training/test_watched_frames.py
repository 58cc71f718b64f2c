"""Errors of frames that are watched."""

from __future__ import annotations

import pytest

from renderer.splats.settings import SplatSettings
from renderer.splats.training.trainer import SplatTrainer
from renderer.splats.training.watched_frames import Errors, WatchedFrames
from tests.renderer.studio import make_sequence


def errors(face: float, lpips: float, body: float = 1e-3) -> Errors:
    return Errors({"body": body, "face": face}, {"face": lpips})


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
