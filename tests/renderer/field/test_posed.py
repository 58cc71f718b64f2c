"""The grid of a pose against asking 24 joints at every sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from renderer.field.drawing import FieldRenderer
from renderer.field.field import PersonField
from renderer.field.posed import direct_canonical
from renderer.field.posed_grid import posed_grid
from renderer.metrics import psnr
from tests.renderer.field.performer import TINY, body, pose, view

SIZES = replace(TINY.sizes, posed_grid=64, volume=(24, 72, 72))


@pytest.fixture(scope="module")
def field() -> PersonField:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        field = PersonField.for_body(SIZES, body())
    with torch.no_grad():  # colours that differ from place to place
        table = field.canonical.table
        assert table is not None
        table[:, 1:] = 2.0 * torch.randn(table.shape[1] - 1)[None] + 0.5 * table[:, 1:]
    return field


@pytest.fixture(scope="module")
def renderer(field) -> FieldRenderer:
    return FieldRenderer(field)


def _transforms(field: PersonField) -> torch.Tensor:
    moment = pose(0.6, 0.8)
    angles = torch.from_numpy(moment.joint_angles).float()
    return field.transforms(angles, torch.zeros(3), refine=False)


def test_bounds_hold_the_posed_body(field, renderer):
    low, high = renderer.support.bounds(_transforms(field))
    posed = body().posed_vertices(pose(0.6, 0.8))
    assert (posed > low.numpy()).all()
    assert (posed < high.numpy()).all()


def test_agrees_with_asking_directly(field, renderer):
    transforms = _transforms(field)
    grid = posed_grid(field, renderer.volume, renderer.support, transforms)
    skin = torch.from_numpy(body().posed_vertices(pose(0.6, 0.8))[::30]).float()
    found, likelihood = grid.canonical(skin)
    direct, sure = direct_canonical(skin, transforms, renderer.volume, SIZES.inverse_rounds)
    assert (likelihood - sure).abs().median() < 0.02
    apart = (found - direct).norm(dim=1)
    assert apart.median() < 0.002
    assert (apart < 0.02).float().mean() > 0.95


def test_the_skin_lies_in_live_cells(field, renderer):
    grid = posed_grid(field, renderer.volume, renderer.support, _transforms(field))
    skin = torch.from_numpy(body().posed_vertices(pose(0.6, 0.8))).float()
    assert grid.holds(skin).float().mean() > 0.999
    assert grid.live.float().mean() < 0.5  # or culling would skip nothing


def test_culling_changes_nothing_that_can_be_seen(field, renderer):
    moment, camera = pose(0.6, 0.8), view(0.3, 32)
    culled = renderer.render(camera, moment)
    field.sizes = replace(SIZES, posed_grid=0)
    try:
        slow = FieldRenderer(field).render(camera, moment)
    finally:
        field.sizes = SIZES
    assert culled[..., 3].max() > 0.9
    assert psnr(culled[..., :3], slow[..., :3]) > 30.0
    assert np.abs(culled[..., 3] - slow[..., 3]).mean() < 0.01
