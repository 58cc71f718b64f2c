"""The training loop: it learns, repeats, resumes, stops, and survives what goes wrong."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import TrainingError, TrainingStopped, UnknownPreset
from renderer.splats.model import SplatModel
from renderer.splats.training import SplatTrainer
from renderer.training import Progress, train
from tests.renderer.studio import make_motion, make_sequence


def ticking(step_s: float = 0.01):
    """A clock that moves on at every look."""
    ticks = itertools.count()
    return lambda: next(ticks) * step_s


def trained(**options) -> SplatModel:
    given = {"iterations": 60, "clock": ticking()} | options
    model = train(make_sequence(), **given)
    assert isinstance(model, SplatModel)
    return model


def test_loss_falls_and_the_model_says_how_it_was_made():
    losses: list[float] = []
    model = trained(iterations=400, on_progress=lambda p: losses.append(p.loss))
    assert losses[-1] < 0.35 * losses[0]
    assert model.metrics["steps"] == 400
    assert 0.5 < model.metrics["seen_share"] <= 1.0
    assert model.data_hash == "of a test"


def test_a_seed_repeats_to_the_bit():
    first, second, other = trained(seed=3), trained(seed=3), trained(seed=4)
    np.testing.assert_array_equal(first.parameters, second.parameters)
    assert (first.parameters != other.parameters).any()


def test_time_ends_the_budget():
    seen: list[Progress] = []
    model = trained(iterations=None, budget_s=2.0, on_progress=seen.append)
    assert model.metrics["train_seconds"] >= 2.0
    assert seen[-1].fraction == 1.0
    assert seen[-1].preview is not None
    assert seen[-1].preview.shape == (384, 384, 3)


def test_stopping_leaves_a_checkpoint_that_goes_on(tmp_path):
    path, reports = tmp_path / "run.checkpoint", []

    def stop() -> bool:
        return len(reports) >= 1

    with pytest.raises(TrainingStopped, match="stopped at step"):
        trained(iterations=120, checkpoint=path, on_progress=reports.append, should_stop=stop)
    assert path.exists()
    resumed = trained(iterations=120, checkpoint=path)
    straight = trained(iterations=120)
    assert resumed.metrics["steps"] == 120
    np.testing.assert_array_equal(resumed.parameters, straight.parameters)


def test_a_foreign_checkpoint_is_refused(tmp_path):
    path, reports = tmp_path / "run.checkpoint", []
    with pytest.raises(TrainingStopped):
        trained(checkpoint=path, on_progress=reports.append, should_stop=lambda: bool(reports),
                iterations=200)  # fmt: skip
    with pytest.raises(TrainingError, match=r"same clip, preset and seed; got .*delete"):
        trained(checkpoint=path, seed=9)
    path.write_bytes(b"no checkpoint")
    with pytest.raises(TrainingError, match="must be a file of an earlier run; got"):
        trained(checkpoint=path)


def poison(monkeypatch, times: int) -> None:
    """From step 100 on, the trainer's weights turn into NaN, `times` times."""
    step, left = SplatTrainer.step, [times]
    count = itertools.count()

    def spoiled(self, fraction):
        loss = step(self, fraction)
        if next(count) >= 100 and left[0]:
            left[0] -= 1
            self.parameters[:] = np.nan
            return float("nan")
        return loss

    monkeypatch.setattr(SplatTrainer, "step", spoiled)


def test_divergence_is_rolled_back(monkeypatch):
    poison(monkeypatch, times=2)
    model = trained(iterations=200)
    assert model.metrics["rollbacks"] == 2
    assert np.isfinite(model.parameters).all()


def test_lasting_divergence_fails_with_the_reason(monkeypatch):
    poison(monkeypatch, times=99)
    with pytest.raises(TrainingError, match="must stay finite; got a loss of nan at step"):
        trained(iterations=200)


def test_a_preset_nobody_knows_is_refused_with_the_list():
    with pytest.raises(UnknownPreset, match=r"must be one of splats.*; got 'slow'"):
        trained(preset="slow")


def test_either_time_or_steps():
    with pytest.raises(TrainingError, match="either budget_s or iterations must be given"):
        trained(iterations=None)


def test_refining_estimated_poses_explains_the_pictures_better():
    truth = make_motion(6)
    angles = truth.joint_angles.copy()
    angles[:, 9] += 0.15 * np.random.default_rng(0).normal(size=(6, 3))
    noisy = replace(truth, joint_angles=angles)
    losses = {}
    for exact in (True, False):
        reported: list[Progress] = []
        sequence = make_sequence(exact=exact, motion=noisy)
        train(sequence, iterations=600, clock=ticking(), on_progress=reported.append)
        losses[exact] = np.mean([progress.loss for progress in reported[-5:]])
    assert losses[False] < 0.75 * losses[True]
