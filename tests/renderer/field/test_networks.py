"""Sizes, starts and places of the four networks."""

from __future__ import annotations

import pytest
import torch

from renderer.field.encoding import encoded_size
from renderer.field.field import PersonField
from renderer.field.networks import (
    Mlp,
    PoseRefiner,
    ResidualMotion,
    SkeletonMotion,
    parameter_count,
)
from renderer.field.settings import FAST
from renderer.field.sizes import FieldSizes, MlpSize
from tests.renderer.field.performer import body

HUMANNERF = FieldSizes(
    colour=MlpSize(depth=8, width=256, skip=6),
    octaves=10,
    latent=256,
    residual=MlpSize(depth=6, width=128, skip=5),
    refiner=MlpSize(depth=4, width=256),
)


def _uniform_prior(sizes: FieldSizes) -> torch.Tensor:
    return torch.full((25, *sizes.volume), 1.0 / 25.0)


def test_humannerfs_sizes_count_as_published():
    with torch.device("meta"):
        assert HUMANNERF.colour is not None
        assert HUMANNERF.refiner is not None
        canonical = Mlp(encoded_size(10, identity=True), 4, HUMANNERF.colour)
        assert parameter_count(canonical) == 494_084
        assert parameter_count(ResidualMotion(HUMANNERF)) == 101_123
        assert parameter_count(PoseRefiner(HUMANNERF.refiner)) == 233_029
        motion = SkeletonMotion(HUMANNERF, _uniform_prior(HUMANNERF))
        assert parameter_count(motion) == pytest.approx(63.59e6, rel=1e-4)


def test_the_fast_preset_counts():
    field = PersonField.for_body(FAST.sizes, body())
    assert field.shell is not None
    assert parameter_count(field.refiner) == 69 * 64 + 64 + 64 * 64 + 64 + 64 * 69 + 69
    assert parameter_count(field.motion) == 0
    assert parameter_count(field.residual) == 0
    assert field.canonical.table is not None
    learnt = int(field.shell.learnt.sum())
    assert field.canonical.table.shape == (learnt + 2, 1 + 4)
    assert parameter_count(field.canonical.mlp) == 4 * 16 + 16 + 16 * 3 + 3


def test_sizes_survive_json():
    for sizes in (HUMANNERF, FAST.sizes):
        assert FieldSizes.from_json(sizes.to_json()) == sizes


def test_the_skip_reads_the_encoding_at_its_layer():
    mlp = Mlp(5, 2, MlpSize(depth=4, width=7, skip=3), reread=3)
    widths = [layer.weight.shape[1] for layer in mlp.hidden]  # type: ignore[union-attr]
    assert widths == [5, 7, 10, 7]


def test_refiner_and_residual_start_from_nothing():
    angles = torch.rand(2, 24, 3)
    refiner = PoseRefiner(MlpSize(depth=2, width=16))
    change = refiner(angles)
    assert (change[:, 0] == 0.0).all()
    assert change.abs().max() < 1e-3
    sizes = FieldSizes(colour=None, residual=MlpSize(depth=2, width=16))
    assert ResidualMotion(sizes)(torch.rand(9, 3), angles[0], 1.0).abs().max() < 1e-3


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
