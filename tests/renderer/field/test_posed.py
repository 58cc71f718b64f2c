"""The grid of a pose against asking 24 joints at every sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from renderer.evaluation.metrics import psnr
from renderer.field.field import PersonField
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.field.skinning.distance_transform import DistanceTransform
from renderer.field.skinning.inverse_skinning import WeightVolume, blended
from renderer.field.skinning.posed_body import direct_canonical
from renderer.field.skinning.posed_grid import PosedGrid, posed_grid
from scene import JOINT_NAMES, Pose
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


def _deeply_bent() -> Pose:
    """Arms hang against the sides, hips are folded: much of the air belongs to two parts."""
    angles = np.zeros((24, 3))
    for name, turn in (
        ("left_shoulder", (0.2, 0.0, -1.6)),
        ("right_shoulder", (0.2, 0.0, 1.6)),
        ("left_hip", (-1.6, 0.0, 0.0)),
        ("right_hip", (-1.6, 0.0, 0.0)),
    ):
        angles[JOINT_NAMES.index(name)] = turn
    return Pose(angles, np.zeros(3))


@pytest.fixture(scope="module")
def bent(field, renderer) -> tuple[PosedGrid, torch.Tensor]:
    moment = _deeply_bent()
    moved = body().skeleton.skinning_transforms(moment.joint_angles, moment.root_translation)
    transforms = torch.from_numpy(moved[:, :3]).float()
    return posed_grid(field, renderer.volume, renderer.support, transforms), transforms


def test_skin_beside_another_part_stays_its_own(renderer, bent):
    grid, transforms = bent
    skin = torch.from_numpy(body().posed_vertices(_deeply_bent())).float()
    rest = torch.from_numpy(body().rest_vertices).float()
    found, _ = grid.canonical(skin)
    averaged, _ = direct_canonical(skin, transforms, renderer.volume, SIZES.inverse_rounds)
    wrong, before = (((p - rest).norm(dim=1) > 0.03).float().mean() for p in (found, averaged))

    assert before > 0.05
    assert wrong < 0.5 * before


def test_air_that_no_place_moves_to_belongs_to_nobody(renderer, bent):
    grid, transforms = bent
    some = torch.nonzero(grid.rows[:, 3] > 0.0)[:, 0]
    found = grid.rows[some, :3] / grid.rows[some, 3:]
    back = blended(found, transforms, renderer.volume.at(found))
    assert (back - grid.corner(some)).norm(dim=1).max() < 0.011


def test_depth_is_the_distance_to_the_rim():
    inside = torch.zeros(9, 9, 9)
    inside[2:7, 2:7, 2:7] = 1.0
    low, high = torch.zeros(3), torch.full((3,), 0.8)
    volume = WeightVolume.of(torch.stack([inside, 1.0 - inside]), low, high)
    depths = DistanceTransform.of(volume)
    z, y, x = torch.nonzero(~depths.live.view(depths.shape)).T
    empty = torch.stack([x, y, z], dim=1) * depths.cell_m
    asked = torch.rand(50, 3, generator=torch.Generator().manual_seed(0)) * 0.3 + 0.25
    corner = depths.corner(depths.index_of(asked).long())
    expected = torch.cdist(corner, empty).amin(dim=1)
    assert expected.max() > 0.15
    assert torch.allclose(depths.at(asked), expected.clamp(max=0.4), atol=1e-5)
    assert float(depths.at(torch.tensor([[0.05, 0.4, 0.4]]))) == 0.0
