"""Sizes, starts and places of the four networks."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from renderer.field.field import PersonField
from renderer.field.networks.encoding import encoded_size
from renderer.field.networks.mlps import (
    Mlp,
    PoseRefiner,
    ResidualMotion,
    SkeletonMotion,
    parameter_count,
)
from renderer.field.settings import FAST, HUMANNERF, PAPER
from renderer.field.sizes import FieldSizes, MlpSize
from tests.renderer.field.performer import body


def _uniform_prior(sizes: FieldSizes) -> torch.Tensor:
    return torch.full((25, *sizes.volume), 1.0 / 25.0)


def _counts(sizes: FieldSizes, joints: int = 24) -> list[int]:
    """Parameters of canonical field, residual, refiner and weight volume."""
    with torch.device("meta"):
        assert sizes.colour is not None
        assert sizes.refiner is not None
        networks = (
            Mlp(encoded_size(sizes.octaves, identity=True), 4, sizes.colour),
            ResidualMotion(sizes, joints),
            PoseRefiner(sizes.refiner, joints),
            SkeletonMotion(sizes, torch.ones(joints + 1, *sizes.volume)),
        )
    return [parameter_count(network) for network in networks]


def test_humannerfs_sizes_count_as_published():
    canonical, residual, refiner, motion = _counts(HUMANNERF.sizes)
    assert (canonical, residual, refiner) == (494_084, 101_123, 233_029)
    assert motion == pytest.approx(63.59e6, rel=1e-4)


def test_the_papers_sizes_keep_the_depths_at_64_units_without_biases():
    encoded, pose = 63, 69
    canonical = encoded * 64 + 2 * 64 * 64 + (64 + encoded) * 64 + 4 * 64 * 64 + 64 * 4
    residual = (36 + pose) * 64 + 2 * 64 * 64 + (64 + 36) * 64 + 2 * 64 * 64 + 64 * 3
    refiner = pose * 64 + 3 * 64 * 64 + 64 * pose
    assert (canonical, residual, refiner) == (36_992, 29_696, 21_120)
    assert _counts(PAPER.sizes)[:3] == [canonical, residual, refiner]
    assert _counts(PAPER.sizes)[3] == _counts(HUMANNERF.sizes)[3]


def test_another_skeleton_brings_its_own_number_of_joints():
    sizes = replace(HUMANNERF.sizes, latent=4, latent_channels=16, volume=(8, 8, 8))
    refiner = PoseRefiner(MlpSize(1, 8), 30)
    assert refiner(torch.zeros(2, 30, 3)).shape == (2, 30, 3)
    residual = ResidualMotion(replace(sizes, residual=MlpSize(2, 8)), 30)
    assert residual(torch.zeros(5, 3), torch.zeros(30, 3), 1.0).shape == (5, 3)
    assert SkeletonMotion(sizes, torch.ones(31, 8, 8, 8))().shape == (31, 8, 8, 8)


def test_the_fast_preset_counts():
    field = PersonField.for_body(FAST.sizes, body())
    assert field.shell is not None
    assert field.refiner is None
    assert parameter_count(field.motion) == 0
    assert parameter_count(field.residual) == 0
    assert field.canonical.table is not None
    learnt = int(field.shell.learnt.sum())
    assert field.canonical.table.shape == (learnt + 2, 1 + 4)
    assert parameter_count(field.canonical.mlp) == 4 * 16 + 16 + 16 * 3 + 3


def test_sizes_survive_json():
    for sizes in (HUMANNERF.sizes, PAPER.sizes, FAST.sizes):
        assert FieldSizes.from_json(sizes.to_json()) == sizes


def test_the_skip_reads_the_encoding_at_its_layer():
    mlp = Mlp(3, 2, MlpSize(depth=4, width=7, skip=3), shared=2)
    widths = [layer.weight.shape[1] for layer in mlp.hidden]  # type: ignore[union-attr]
    assert widths == [5, 7, 10, 7]


def _plainly_filled(mlp: Mlp) -> Mlp:
    """Weights that anyone can write down: no generator's numbers, and none alike."""
    for parameter in mlp.parameters():
        count = torch.arange(parameter.numel(), dtype=torch.float64).view(parameter.shape)
        scale = 1.5 / parameter.shape[-1] ** 0.5
        parameter.data = scale * torch.sin(1.0 + 0.7 * count)
    return mlp.double()


@pytest.mark.parametrize(
    ("name", "golden"),
    [
        ("humannerf canonical", [1.33434, 0.258985, 1.16901]),
        ("humannerf residual", [1.31892, 0.830307, -0.00153677]),
        ("paper canonical", [0.00121906, 0.00158895, 0.000954302]),
        ("paper residual", [0.0163737, 0.0259765, 0.0191569]),
    ],
)
def test_golden_outputs_hold_the_place_of_every_skip(name, golden):
    """Made anew by printing `out` below: after a change of the networks alone."""
    preset, network = name.split()
    sizes = {"humannerf": HUMANNERF, "paper": PAPER}[preset].sizes
    size = sizes.colour if network == "canonical" else sizes.residual
    assert size is not None
    inputs, shared = (63, 0) if network == "canonical" else (36, 69)

    def output(size: MlpSize) -> torch.Tensor:
        mlp = _plainly_filled(Mlp(inputs, 3, size, shared))
        row = torch.cos(torch.arange(inputs, dtype=torch.float64))[None]
        pose = torch.sin(torch.arange(shared, dtype=torch.float64)) if shared else None
        with torch.no_grad():
            return mlp(row, pose)[0]

    out = output(size)
    assert out.tolist() == pytest.approx(golden, rel=1e-5)
    assert size.skip is not None
    for place in (size.skip - 1, size.skip + 1):
        elsewhere = output(replace(size, skip=place))
        assert elsewhere.tolist() != pytest.approx(golden, rel=2e-5), place


@pytest.mark.parametrize("preset", [HUMANNERF, PAPER])
def test_last_layers_of_refiner_and_residual_start_uniformly(preset):
    """U(-1e-5, 1e-5): all of the range, nothing beyond it; biases, where there are any, at nil."""
    assert preset.sizes.refiner is not None
    torch.manual_seed(0)
    for network in (PoseRefiner(preset.sizes.refiner, 24), ResidualMotion(preset.sizes, 24)):
        weight = network.mlp.last.weight.detach()
        assert weight.abs().max() <= 1.000001e-5
        assert weight.max() > 0.9e-5
        assert weight.min() < -0.9e-5
        assert float(weight.abs().mean()) == pytest.approx(0.5e-5, rel=0.15)
        assert network.mlp.last.bias is None or not network.mlp.last.bias.any()


def test_refiner_and_residual_start_from_nothing():
    angles = torch.rand(2, 24, 3)
    refiner = PoseRefiner(MlpSize(depth=2, width=16), 24)
    change = refiner(angles)
    assert (change[:, 0] == 0.0).all()
    assert change.abs().max() < 1e-3
    sizes = FieldSizes(colour=None, residual=MlpSize(depth=2, width=16))
    assert ResidualMotion(sizes, 24)(torch.rand(9, 3), angles[0], 1.0).abs().max() < 1e-3


def test_without_a_cnn_the_prior_is_the_volume():
    prior = _uniform_prior(FAST.sizes)
    assert torch.equal(SkeletonMotion(FAST.sizes, prior)(), prior)


def test_the_cnn_bends_the_prior_and_keeps_probabilities():
    sizes = FieldSizes(colour=None, volume=(8, 8, 8), latent=4, latent_channels=16)
    prior = torch.softmax(torch.rand(25, 8, 8, 8), dim=0)
    motion = SkeletonMotion(sizes, prior)
    volume = motion()
    assert volume.shape == prior.shape
    assert torch.allclose(volume.sum(dim=0), torch.ones(8, 8, 8), atol=1e-5)
    volume[0].sum().backward()
    assert motion.latent is not None
    assert motion.latent.grad is not None
    assert torch.isfinite(motion.latent.grad).all()
