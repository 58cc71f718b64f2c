"""Each speed-up against the slow path, with the same weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from renderer.evaluation.metrics import psnr
from renderer.field.field import PersonField
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.field.skinning.posed_body import Support, direct_canonical, reached_cells
from renderer.presets import EXACT, SPEED_UPS
from scene.arrays import Array
from tests.renderer.field.performer import body, pose, view
from tests.renderer.field.shaped import SMALL, shaped_field

CAMERA, MOMENT = view(0.3, 40), pose(0.6, 0.8)


@pytest.fixture(scope="module")
def field() -> PersonField:
    return shaped_field()


def _drawn(field: PersonField, names: tuple[str, ...]) -> tuple[Array, int]:
    """The picture with the speed-ups `names`, and how many samples the canonical MLP was asked."""
    sizes = SMALL
    for name in names:
        sizes = SPEED_UPS[name].apply(sizes)
    asked: list[int] = []
    assert field.canonical.mlp is not None
    hook = field.canonical.mlp.register_forward_hook(
        lambda _, inputs, __: asked.append(len(inputs[0]))
    )
    field.sizes = sizes
    try:
        return FieldRenderer(field).render(CAMERA, MOMENT), sum(asked)
    finally:
        field.sizes = SMALL
        hook.remove()


@pytest.fixture(scope="module")
def slow(field) -> tuple[Array, int]:
    return _drawn(field, ())


def test_the_slow_path_shows_a_body(slow):
    picture, _ = slow
    assert picture[..., 3].max() > 0.9
    assert 0.03 < picture[..., 3].mean() < 0.3


@pytest.mark.parametrize("names", [("cull",), ("occupancy",), ("early-stop",), EXACT[:-1]])
def test_exact_speed_ups_show_the_same(field, slow, names):
    picture, asked = _drawn(field, names)
    assert psnr(picture[..., :3], slow[0][..., :3]) > 50.0
    assert np.abs(picture[..., 3] - slow[0][..., 3]).max() < 0.02
    assert asked < 0.99 * slow[1]


def test_all_exact_speed_ups_ask_a_sixth(field, slow):
    assert 6 * _drawn(field, EXACT)[1] < slow[1]  # measured: 7.9; time falls further, see bench


def test_the_posed_grid_costs_what_it_says(field, slow):
    picture, _ = _drawn(field, ("posed-grid",))
    assert 30.0 < psnr(picture[..., :3], slow[0][..., :3]) < 50.0


def test_baking_changes_nothing(slow):
    field = shaped_field()
    before = field.weight_volume().rows
    field.bake()
    assert field.motion.latent is None
    assert not list(field.motion.parameters())
    assert torch.equal(field.weight_volume().rows, before)
    assert np.allclose(_drawn(field, ())[0], slow[0], atol=1e-5)


def test_cells_that_no_bone_reaches_hold_nobody(field):
    volume = field.weight_volume()
    support = Support.of(volume)
    transforms = field.transforms(
        torch.from_numpy(MOMENT.joint_angles).float(), torch.zeros(3), refine=False
    )
    cells = reached_cells(support, transforms)
    generator = torch.Generator().manual_seed(0)
    points = cells.low + torch.rand(20_000, 3, generator=generator) * (cells.high - cells.low)
    _, likelihood = direct_canonical(points, transforms, volume, 0)
    reached = cells.live[cells.index_of(points).long()]
    assert 0.05 < reached.float().mean() < 0.9
    assert likelihood[~reached].max() < 1e-3


def test_bones_asked_where_they_reach_say_the_same(field):
    volume = field.weight_volume()
    transforms = field.transforms(
        torch.from_numpy(MOMENT.joint_angles).float(), torch.zeros(3), refine=False
    )
    skin = torch.from_numpy(body().posed_vertices(MOMENT)[::50]).float()
    whole = direct_canonical(skin, transforms, volume, 0)
    some = direct_canonical(skin, transforms, volume, 0, Support.of(volume))
    assert torch.allclose(some[1], whole[1], atol=1e-3)
    assert np.quantile((some[0] - whole[0]).norm(dim=1).numpy(), 0.99) < 2e-3


def test_the_residual_moves_before_emptiness_is_asked(field):
    """A point that the residual carries into an empty cell is not drawn there."""
    found = torch.zeros(1, 3) + torch.tensor([0.0, 1.1, 0.0])
    assert field.occupied_at(found).all()
    assert not field.occupied_at(found + torch.tensor([0.0, 0.0, 0.6])).any()


def test_no_speed_up_is_lost_by_being_repeated():
    sizes = replace(SMALL)
    for name, speed_up in SPEED_UPS.items():
        once = speed_up.apply(sizes)
        assert once != sizes, name
        assert speed_up.apply(once) == once, name
