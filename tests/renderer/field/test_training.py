"""Training a field: it learns, repeats, resumes, and survives what a clip may bring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.devices import best_device
from renderer.evaluation.evaluate import evaluate
from renderer.field.settings import FieldSettings
from renderer.field.sizes import MlpSize
from renderer.field.training.trainer import FieldTrainer
from scene import Motion, PoseTrust, Sequence
from tests.renderer.field.performer import TINY, sequence, without_surface
from tests.shared_data import shared_data


def _train(clip: Sequence, steps: int, settings: FieldSettings = TINY, seed: int = 0):
    trainer = FieldTrainer(clip, "fast", settings, seed)
    losses = [trainer.step(step / steps) for step in range(steps)]
    return trainer, losses


def test_learns_views_and_poses_it_never_saw():
    trainer, losses = _train(sequence(), 150)
    assert np.mean(losses[-20:]) < 0.25 * np.mean(losses[:5])
    figures = evaluate(trainer.finish({}), sequence())["psnr"]
    assert figures["novel_view"]["body_crop"] > 17.0  # a grey body has 11
    assert figures["unseen_pose"]["body_crop"] > 16.0


def test_the_same_seed_gives_the_same_losses():
    first, again, other = (_train(sequence(), 4, seed=s)[1] for s in (3, 3, 4))
    # a GPU adds up in another order each time
    assert first == (again if best_device().type == "cpu" else pytest.approx(again, rel=1e-3))
    assert first != other


def test_a_restored_run_goes_on_as_if_never_cut():
    trainer, _ = _train(sequence(), 3)
    state = trainer.state()
    expected = [trainer.step(0.5) for _ in range(3)]
    fresh = FieldTrainer(sequence(), "fast", TINY, 0)
    fresh.restore({name: value.copy() for name, value in state.items()})
    assert [fresh.step(0.5) for _ in range(3)] == pytest.approx(expected, rel=1e-3)


def test_slowing_down_halves_what_a_step_moves():
    def moved(halvings: int) -> float:
        trainer = FieldTrainer(sequence(), "fast", TINY, 0)
        before = trainer.state()["field.canonical.table"]
        for _ in range(halvings):
            trainer.halve_learning_rate()
        trainer.step(0.0)
        return float(np.abs(trainer.state()["field.canonical.table"] - before).max())

    assert moved(1) == pytest.approx(0.5 * moved(0), rel=1e-3)


def test_the_preview_shows_somebody():
    trainer, _ = _train(sequence(), 2)
    picture = trainer.preview()
    assert picture.shape == (128, 128, 3)
    assert picture.std() > 0.02


def test_exact_poses_stay_and_estimates_are_refined():
    exact, _ = _train(sequence(), 12)
    assert np.array_equal(exact.finish({}).motion.joint_angles, sequence().motion.joint_angles)
    eager = replace(TINY, motion_rate=1e-2)
    refined, _ = _train(replace(sequence(), pose_trust=PoseTrust.ESTIMATED), 12, eager)
    change = refined.finish({}).motion.joint_angles - sequence().motion.joint_angles
    assert 1e-4 < np.abs(change).max() < 0.5


def test_refinement_wins_back_a_bent_estimate():
    clip = sequence()
    bent = clip.motion.joint_angles.copy()
    bent[:, 16:18, 2] += 0.25  # both shoulders, every frame
    motion = Motion(clip.motion.times_s, bent, clip.motion.root_translation, clip.motion.confidence)
    poses = [motion.pose(index) for index in range(len(motion))]

    class Estimated:
        def __len__(self) -> int:
            return len(clip.train)

        def __getattr__(self, name: str):
            return getattr(clip.train, name)

        def pose(self, index: int):
            return poses[index]

    guessed = replace(clip, train=Estimated(), motion=motion, pose_trust=PoseTrust.ESTIMATED)
    settings = replace(TINY, motion_rate=5e-3)
    without, _ = _train(replace(guessed, pose_trust=PoseTrust.EXACT), 100, settings)
    refined, _ = _train(guessed, 100, settings)
    seen = [
        evaluate(t.finish({}), guessed)["psnr"]["training_view"]["body_crop"]
        for t in (without, refined)
    ]
    assert seen[1] > seen[0]


def test_a_body_known_by_its_joints_alone_is_trained():
    _, losses = _train(without_surface(sequence()), 60)
    assert np.mean(losses[-10:]) < 0.5 * np.mean(losses[:3])


def test_every_network_of_the_paper_learns():
    sizes = replace(
        TINY.sizes,
        grid=None,
        octaves=4,
        colour=MlpSize(2, 32, skip=2),
        latent=8,
        latent_channels=16,
        volume=(16, 16, 16),
        residual=MlpSize(2, 16),
        posed_grid=0,
        inverse_rounds=0,
        step_m=0.06,
    )
    settings = replace(
        TINY, sizes=sizes, rays_a_frame=64, residual_from=0.2, residual_until=0.5, field_rate=5e-3
    )
    clip = replace(sequence(), pose_trust=PoseTrust.ESTIMATED)
    trainer, _ = _train(clip, 1, settings)
    before = trainer.state()
    losses = [trainer.step(0.3 + 0.02 * step) for step in range(25)]
    assert np.mean(losses[-5:]) < np.mean(losses[:5])
    after = trainer.state()
    for network in ("refiner", "motion", "residual", "canonical"):
        names = [name for name in after if name.startswith(f"field.{network}")]
        assert names
        assert any((after[name] != before[name]).any() for name in names), network


def test_patches_with_a_perceptual_loss():
    backbone = shared_data("models") / "squeezenet1_1_features.pth"
    settings = replace(TINY, patch_px=20, rays_a_frame=400, lpips_backbone=backbone)
    _, losses = _train(sequence(), 25, settings)
    assert np.mean(losses[-5:]) < np.mean(losses[:5])
