"""The training loop: it learns, repeats, resumes, stops, and survives what goes wrong."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.storage import open_sequence
from capture.studio import make_sequence as make_studio_sequence
from renderer.errors import TrainingError, TrainingStopped, UnknownPreset
from renderer.evaluation.evaluate import evaluate
from renderer.splats.model import SplatModel
from renderer.splats.training.trainer import SplatTrainer
from renderer.training import Progress, train
from scene import FrameSource, Motion, Pose
from scene.sequence import PoseTrust
from tests.renderer.clocks import ticking
from tests.renderer.studio import make_sequence


def trained(**options) -> SplatModel:
    given = {"iterations": 60, "clock": ticking()} | options
    model = train(make_sequence(), **given)
    assert isinstance(model, SplatModel)
    return model


def test_loss_falls_and_the_model_says_how_it_was_made():
    losses: list[float] = []
    model = trained(iterations=700, on_progress=lambda p: losses.append(p.loss))
    assert losses[-1] < 0.2 * losses[0]
    assert model.metrics["steps"] == 700
    assert 0.25 < model.metrics["seen_share"] < 0.93  # top and bottom never face the camera
    assert model.data_hash == "of a test"


def test_a_seed_repeats_to_the_bit():
    first, second, other = (trained(seed=seed, iterations=20) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.parameters, second.parameters)
    assert not np.array_equal(first.parameters, other.parameters)


def test_time_ends_the_budget():
    seen: list[Progress] = []
    model = trained(iterations=None, budget_s=2.0, on_progress=seen.append)
    assert model.metrics["train_seconds"] >= 2.0
    assert seen[-1].fraction == 1.0
    assert seen[-1].preview is not None
    assert seen[-1].preview.shape == (384, 384, 3)
    assert re.fullmatch(r"learning the looks \(step \d+, loss 0\.\d{4}\)", seen[-1].message)


def test_a_stopped_field_goes_on_too(tmp_path):
    path, steps = tmp_path / "run.checkpoint", []

    def fit(**options):
        return train(
            make_sequence(),
            preset="fast",
            iterations=60,
            checkpoint=path,
            clock=ticking(),
            on_progress=lambda progress: steps.append(progress.step),
            **options,
        )

    with pytest.raises(TrainingStopped):
        fit(should_stop=lambda: bool(steps))
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.checkpoint"]
    stopped = steps[-1]
    assert 0 < stopped < 60
    assert fit().metrics["steps"] == 60
    assert min(steps[steps.index(stopped) + 1 :]) >= stopped


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


def stopped_early(folder: Path) -> Path:
    """The checkpoint of a training of 200 steps that was stopped by its first report."""
    path, reports = folder / "run.checkpoint", []
    with pytest.raises(TrainingStopped):
        trained(
            checkpoint=path,
            on_progress=reports.append,
            should_stop=lambda: bool(reports),
            iterations=200,
        )
    return path


def test_a_foreign_checkpoint_is_refused(tmp_path):
    path = stopped_early(tmp_path)
    with pytest.raises(TrainingError, match=r"same clip, preset and seed; got .*delete"):
        trained(checkpoint=path, seed=9)
    path.write_bytes(b"no checkpoint")
    with pytest.raises(TrainingError, match="must be a file of an earlier run; got"):
        trained(checkpoint=path)


def test_a_checkpoint_of_splats_in_other_places_begins_anew(tmp_path):
    path = stopped_early(tmp_path)
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["state.places"][0] += 0.01
    with path.open("wb") as file:
        np.savez(file, **arrays)
    anew, went_on = trained(iterations=60), trained(checkpoint=path, iterations=60)
    assert went_on.metrics["steps"] == 60
    np.testing.assert_array_equal(went_on.parameters, anew.parameters)


def poison(monkeypatch, times: int) -> None:
    """From step 100 on, the trainer's weights turn into NaN, `times` times."""
    step, left = SplatTrainer.step, [times]
    count = itertools.count()

    def spoiled(self, fraction):
        loss = step(self, fraction)
        if next(count) >= 100 and left[0]:
            left[0] -= 1
            self.splats.parameters[:] = np.nan
            return float("nan")
        return loss

    monkeypatch.setattr(SplatTrainer, "step", spoiled)


def test_divergence_is_rolled_back(monkeypatch):
    poison(monkeypatch, times=2)
    model = trained(iterations=200)
    assert model.metrics["rollbacks"] == 2
    assert 0.0 < model.metrics["rollback_seconds"] < model.metrics["train_seconds"]
    assert np.isfinite(model.parameters).all()


def test_lasting_divergence_fails_with_the_reason(monkeypatch):
    poison(monkeypatch, times=99)
    with pytest.raises(TrainingError, match=r"must stay finite .*; got a loss of nan at step"):
        trained(iterations=200)


def test_a_preset_nobody_knows_is_refused_with_the_list():
    with pytest.raises(UnknownPreset, match=r"must be one of splats.*; got 'slow'"):
        trained(preset="slow")


def test_either_time_or_steps():
    with pytest.raises(TrainingError, match="either budget_s or iterations must be given"):
        trained(iterations=None)


class Claimed:
    """Frames of `source` with the poses that `motion` claims."""

    def __init__(self, source: FrameSource, motion: Motion) -> None:
        self._source, self._motion = source, motion
        self.camera, self.image, self.mask = source.camera, source.image, source.mask

    def __len__(self) -> int:
        return len(self._source)

    def pose(self, index: int) -> Pose:
        return self._motion.pose(index)


def test_refining_poses_wins_back_sharpness_on_unseen_views(tmp_path):
    make_studio_sequence(tmp_path / "seq", frames=16, size=64, test_cameras=1)
    clip = open_sequence(tmp_path / "seq")
    noise = np.deg2rad(4.0) * np.random.default_rng(0).normal(size=clip.motion.joint_angles.shape)
    noisy = replace(clip.motion, joint_angles=clip.motion.joint_angles + noise)
    psnr = {}
    for trust in (PoseTrust.EXACT, PoseTrust.ESTIMATED):
        claimed = replace(clip, train=Claimed(clip.train, noisy), motion=noisy, pose_trust=trust)
        model = train(claimed, iterations=300, clock=ticking(0.001))
        psnr[trust] = evaluate(model, clip)["psnr"]["novel_view"]["body_crop"]
    # measured: 22.1 dB with the noise taken for truth, 23.8 refined
    assert psnr[PoseTrust.ESTIMATED] > psnr[PoseTrust.EXACT] + 1.0
