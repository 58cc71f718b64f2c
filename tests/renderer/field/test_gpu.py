"""The fused kernels of a field against the path that asks torch: the same picture."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from benchmarks.field_speed import fitted
from renderer.devices import best_device
from renderer.evaluation.metrics import psnr
from renderer.field.field import PersonField
from renderer.field.rendering import field_renderer
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.field.rendering.gpu import FusedDrawing, draws
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.settings import PAPER
from renderer.field.skinning.posed_body import Support, occupied_before_residual
from renderer.presets import EXACT, SPEED_UPS
from tests.renderer.field.performer import body, pose, view

SIZES = replace(PAPER.sizes, samples_a_ray=10, volume=(16, 16, 16), latent=0)
for name in EXACT:
    SIZES = SPEED_UPS[name].apply(SIZES)


def _moved(cells: OccupancyGrid, device: torch.device) -> OccupancyGrid:
    return replace(
        cells, low=cells.low.to(device), high=cells.high.to(device), live=cells.live.to(device)
    )


@cache
def field() -> PersonField:
    """A field that holds a body, with a residual that is not nil."""
    made = fitted(replace(PAPER, sizes=SIZES), body(), 60)
    assert made.residual is not None
    with torch.no_grad():
        made.residual.mlp.last.weight.mul_(1e3)
    device = best_device()
    made = made.to(device)
    assert made.occupied is not None
    made.occupied = _moved(made.occupied, device)
    return made


def _drawn(person: FusedDrawing, support: Support, camera, moment) -> np.ndarray:
    """As `FieldRenderer` calls it, on whatever device."""
    device = best_device()
    angles = torch.from_numpy(moment.joint_angles).float().to(device)
    root = torch.from_numpy(moment.root_translation).float().to(device)
    with torch.no_grad():
        transforms = field().transforms(angles, root, refine=False)
        before = occupied_before_residual(field(), angles)
        assert before is not None
        box = support.bounds(transforms)
        return person.render(camera, box, transforms, angles, before).copy()


@pytest.mark.parametrize("opened", [None, 0.6], ids=["rigid", "opening"])
def test_a_field_drawn_by_fused_kernels_is_the_same_picture(opened, monkeypatch):
    monkeypatch.setattr(field(), "residual_opened", opened)
    volume = field().weight_volume()
    support = Support.of(volume)
    camera = view(0.4, 160).cropped(75, 43, 6, 4)
    moment = pose(0.3, 0.5)
    drawn = _drawn(FusedDrawing(field(), volume, support), support, camera, moment)
    monkeypatch.setattr(field_renderer, "draws", lambda *_: False)
    plain = FieldRenderer(field(), (volume, support))
    expected = plain.render(camera, moment)
    assert 0.05 < expected[..., 3].mean() < 0.95
    assert psnr(drawn[..., :3], expected[..., :3]) > 50.0
    assert np.abs(drawn - expected).max() < 0.02


def test_a_view_without_anybody_is_empty():
    volume = field().weight_volume()
    support = Support.of(volume)
    camera = view(0.0, 160).cropped(0, 0, 6, 4)
    drawn = _drawn(FusedDrawing(field(), volume, support), support, camera, pose(0.0))
    assert not drawn.any()


def test_only_what_the_kernels_know_is_drawn_by_them():
    cuda, cpu = torch.device("cuda"), torch.device("cpu")
    assert draws(field(), cuda)
    assert not draws(field(), cpu)
    for other in (
        replace(SIZES, backend="torch"),
        replace(SIZES, posed_grid=32),
        replace(SIZES, inverse_rounds=2),
        replace(SIZES, occupancy=False),
        replace(SIZES, samples_a_ray=0),
    ):
        assert not draws(_as(other), cuda)


def _as(sizes) -> PersonField:
    other = PersonField(
        sizes, field().skeleton, field().motion.prior, field().low, field().high, None
    )
    other.occupied = field().occupied
    return other
