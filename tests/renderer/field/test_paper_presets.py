"""The presets of the paper: a handful of iterations each, what their models say and keep."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from renderer.errors import TrainingError
from renderer.field.field import PersonField
from renderer.field.model import FieldModel
from renderer.field.rendering.ray_marching import Samples, alphas, composite, compositing_weights
from renderer.field.settings import HUMANNERF, PAPER, FieldSettings
from renderer.field.sizes import MlpSize
from renderer.field.skinning.inverse_skinning import WeightVolume, rotations, skinning_transforms
from renderer.field.skinning.posed_body import direct_canonical
from renderer.field.training.trainer import FieldTrainer
from renderer.model_files import load_model, save_model
from renderer.presets import SPEED_UPS
from renderer.training import train
from scene import PoseTrust
from tests.renderer.clocks import ticking
from tests.renderer.field.performer import pose, sequence, view


def _small(settings: FieldSettings, *speed_ups: str) -> FieldSettings:
    """The preset as it is, but for a tenth of its samples and channels, in plain torch."""
    sizes = settings.sizes
    for name in speed_ups:
        sizes = SPEED_UPS[name].apply(sizes)
    sizes = replace(sizes, latent_channels=16, samples_a_ray=12, backend="torch")
    return replace(settings, sizes=sizes, rays_a_frame=400, iterations=150_000)


@pytest.mark.parametrize("settings", [HUMANNERF, PAPER], ids=["humannerf", "paper"])
def test_a_handful_of_iterations_learn(settings):
    trainer = FieldTrainer(sequence(), "of a test", _small(settings), 0)
    before = trainer.state()
    losses = [trainer.step(0.4) for _ in range(6)]
    assert np.isfinite(losses).all()
    after = trainer.state()
    for network in ("motion", "residual", "canonical"):
        names = [name for name in after if name.startswith(f"field.{network}")]
        assert any((after[name] != before[name]).any() for name in names), network


def test_fused_networks_learn_as_plain_ones_do():
    losses = []
    for backend in ("fused", "torch"):
        settings = _small(PAPER)
        settings = replace(
            settings, sizes=replace(settings.sizes, backend=backend, samples_a_ray=3)
        )
        trainer = FieldTrainer(sequence(), "of a test", settings, 0)
        losses.append([trainer.step(0.4) for _ in range(2)])
    assert losses[0] == pytest.approx(losses[1], rel=2e-2)


def test_gradients_lie_in_memory_as_their_parameters_do():
    settings = _small(PAPER)
    settings = replace(settings, sizes=replace(settings.sizes, backend="fused", samples_a_ray=3))
    trainer = FieldTrainer(sequence(), "of a test", settings, 0)
    trainer.step(0.4)
    learnt = [p for p in trainer.field.parameters() if p.grad is not None]
    assert learnt
    assert all(p.grad is not None and p.grad.stride() == p.stride() for p in learnt)


def test_no_run_starts_black():
    trainer = FieldTrainer(sequence(), "of a test", _small(PAPER), 0)
    model = trainer.finish({"steps": 0})
    alpha = model.render(view(0.3, 24), pose(0.2))[..., 3]
    assert 0.3 < alpha.max() < 1.0


def test_a_model_says_how_its_schedule_was_scaled():
    trainer = FieldTrainer(sequence(), "of a test", _small(PAPER), 0)
    metrics = trainer.finish({"steps": 300}).metrics
    assert metrics["published_iterations"] == 150_000
    assert metrics["schedule_scale"] == pytest.approx(0.002)


@pytest.mark.parametrize(
    ("fraction", "opened"),
    [(0.06, None), (10_000 / 150_000, 0.0), (0.2, 0.5), (50_000 / 150_000, 1.0), (0.9, 1.0)],
)
def test_the_residual_opens_between_10k_and_50k(fraction, opened):
    trainer = FieldTrainer(sequence(), "of a test", _small(PAPER), 0)
    trainer.step(fraction)
    now = trainer.field.residual_opened
    assert now is None if opened is None else now == pytest.approx(opened, abs=1e-6)


def test_rates_fall_by_a_tenth_over_500k():
    estimated = replace(
        sequence(), pose_trust=PoseTrust.ESTIMATED
    )  # so that poses are refined as well
    trainer = FieldTrainer(estimated, "of a test", _small(PAPER), 0)
    before = trainer.state()
    trainer.step(1.0)  # Adam's first is as long as its rate
    after = trainer.state()
    share = 0.1 ** (150_000 / 500_000)
    rates = {"canonical": 5e-4, "motion": 5e-5, "residual": 5e-5, "refiner": 5e-5}
    for network, rate in rates.items():
        names = [name for name in after if name.startswith(f"field.{network}")]
        moved = max(float(np.abs(after[name] - before[name]).max()) for name in names)
        assert moved == pytest.approx(rate * share, rel=1e-2), network


def test_a_perceptual_loss_needs_patches():
    with pytest.raises(TrainingError, match=r"must go with a preset that trains on patches.*fast"):
        train(sequence(), preset="fast", iterations=1, lpips_backbone=Path("a"), clock=ticking())


@pytest.mark.parametrize("baked", [False, True])
def test_files_keep_what_is_baked_and_what_is_empty(baked, tmp_path):
    added = ("baked", "occupancy") if baked else ("occupancy",)
    trainer = FieldTrainer(sequence(), "of a test", _small(PAPER, *added), 0)
    trainer.step(0.5)
    model = trainer.finish({"steps": 1})
    assert (model.field.motion.latent is None) is baked
    assert model.field.occupied is not None
    save_model(model, tmp_path / "model.safetensors")
    again = load_model(tmp_path / "model.safetensors")
    assert isinstance(again, FieldModel)
    assert again.field.occupied is not None
    assert torch.equal(again.field.occupied.live, model.field.occupied.live)
    if baked:
        assert torch.equal(again.field.motion(), model.field.motion())
    camera, moment = view(0.4, 12), pose(0.1, 0.5)
    assert np.allclose(again.render(camera, moment), model.render(camera, moment), atol=1e-5)


def test_a_step_whose_gradients_are_not_finite_teaches_nothing():
    trainer = FieldTrainer(sequence(), "of a test", _small(PAPER), 0)
    trainer.step(0.0)
    assert trainer.field.canonical.mlp is not None
    with torch.no_grad():
        trainer.field.canonical.mlp.last.weight[0, 0] = float("nan")
    before = trainer.state()
    assert np.isnan(trainer.step(0.0))
    after = trainer.state()
    name = "field.canonical.mlp.hidden.0.weight"
    assert np.array_equal(after[name], before[name])


def test_a_body_that_vanishes_is_told_at_once():
    trainer = FieldTrainer(sequence(), "of a test", replace(_small(PAPER), frames_a_step=8), 0)
    assert np.isfinite(trainer.step(0.0))
    assert trainer.field.canonical.mlp is not None
    with torch.no_grad():  # a density far below nil everywhere: the ReLU is dead
        for parameter in trainer.field.canonical.mlp.parameters():
            parameter.abs_()
        trainer.field.canonical.mlp.last.weight[3] = -1e3
    assert trainer.step(0.0) == float("inf")


def test_likelihood_is_at_most_one_where_parts_meet():
    """An arm against the side: both claim the place, and it is still there once."""
    volume = torch.zeros(3, 4, 4, 4)
    volume[:2] = 0.8
    weights = WeightVolume.of(volume, torch.full((3,), -1.0), torch.ones(3))
    still = torch.cat([torch.eye(3), torch.zeros(3, 1)], dim=1).expand(2, 3, 4)
    _, likelihood = direct_canonical(torch.zeros(1, 3), still, weights, 0)
    assert likelihood.item() == 1.0


def test_gradients_of_a_pixel_against_finite_differences():
    """All of it at once, in float64: kinematics, inverse skinning, residual, field, compositing."""
    sizes = replace(
        _small(HUMANNERF).sizes,
        colour=MlpSize(3, 8, skip=2),
        octaves=2,
        residual=MlpSize(2, 8),
        residual_octaves=2,
        refiner=None,
        latent=0,
        volume=(6, 6, 6),
    )
    torch.manual_seed(0)
    field = PersonField.for_body(sizes, sequence().body).double()
    field.residual_opened = 0.7
    count = 5
    line = torch.linspace(-0.08, 0.09, count).double()
    origin = torch.tensor([0.013, 1.17, 0.0]).double()
    points = origin + line[:, None] * torch.tensor([0.05, 0.1, 1.0]).double()
    step = torch.full((count,), 0.04).double()
    samples = Samples(
        torch.zeros(count, dtype=torch.long), torch.arange(count), points, line, step, 1, count
    )
    angles = torch.from_numpy(pose(0.1, 0.2).joint_angles)

    def pixel(turn: torch.Tensor, volume: torch.Tensor, first: torch.Tensor) -> torch.Tensor:
        posed = torch.cat([turn[None], angles[1:]])
        transforms = skinning_transforms(
            rotations(posed), torch.zeros(3).double(), field.rest_joints, field.skeleton.parents
        )
        weights = WeightVolume.of(volume, field.low, field.high)
        found, likelihood = direct_canonical(points, transforms, weights, 0)
        colours, density = torch.func.functional_call(
            field.canonical, {"mlp.hidden.0.weight": first}, (field.moved(found, posed),)
        )
        blend, _ = compositing_weights(alphas(density, likelihood, step), samples)
        return composite(blend, colours, samples)

    first = field.canonical.mlp.hidden[0].weight.detach().clone()  # type: ignore[union-attr]
    inputs = (
        angles[0].clone().requires_grad_(True),
        field.motion.prior.clone().requires_grad_(True),
        first.requires_grad_(True),
    )
    assert torch.autograd.gradcheck(pixel, inputs, eps=1e-7, atol=1e-5, fast_mode=True)
