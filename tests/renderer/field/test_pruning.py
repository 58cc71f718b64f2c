"""Floaters go, the person stays."""

from __future__ import annotations

import torch

from renderer.field.field import PersonField
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.training.pruning import occupied_cells, prune_grid
from tests.renderer.field.performer import TINY, body
from tests.renderer.field.shaped import SMALL

FLOATER = torch.tensor([0.45, 0.75, 0.02])
CHEST = torch.tensor([0.0, 1.15, 0.0])


def _density_at(field: PersonField, place: torch.Tensor) -> float:
    with torch.no_grad():
        return float(field.canonical(place[None])[1])


def test_a_floater_in_a_grid_is_emptied_and_the_body_is_not():
    field = PersonField.for_body(TINY.sizes, body())
    assert field.shell is not None
    table = field.canonical.table
    assert table is not None
    before, deep = _density_at(field, CHEST), torch.from_numpy(field.shell.deep)
    assert prune_grid(field.canonical, deep) == 0  # a fresh shell has none
    with torch.no_grad():  # the border of the grid stands for a place far from the body
        row = int(field.canonical.rows.view(deep.shape)[0, 0, 0])
        assert row == 0
        field.canonical.rows.view(deep.shape)[0, 0, 0] = 2
        table[2, 0] = 5.0
    assert prune_grid(field.canonical, deep) >= 1
    assert table[2, 0] < -10.0
    assert _density_at(field, CHEST) == before


class Balls(torch.nn.Module):
    """Density of a large ball at the chest and a small one apart."""

    def forward(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        chest = (points - CHEST).norm(dim=1) < 0.15
        floater = (points - FLOATER).norm(dim=1) < 0.08
        return torch.zeros_like(points), 50.0 * (chest | floater).float()


def _cells(balls: torch.nn.Module) -> OccupancyGrid:
    field = PersonField.for_body(SMALL, body())
    volume = field.weight_volume()
    everywhere = torch.full_like(volume.channels, 1.0 / len(volume.channels))
    likely = type(volume).of(
        everywhere.view(-1, *volume.shape), volume.low, volume.high
    )  # every place belongs to some bone
    return occupied_cells(balls, likely)  # type: ignore[arg-type]


def test_only_the_largest_part_of_an_mlp_is_occupied(unchecked_annotations):
    cells = _cells(Balls())
    here, apart = (cells.live[cells.index_of(place[None]).long()] for place in (CHEST, FLOATER))
    assert here.all()
    assert not apart.any()
    assert cells.live.float().mean() < 0.1


class Nothing(Balls):
    """No density at all."""

    def forward(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.zeros_like(points), torch.zeros(len(points))


def test_where_nothing_was_learnt_nothing_is_cut_away(unchecked_annotations):
    cells = _cells(Nothing())
    assert cells.holds(cells.low + torch.rand(5000, 3) * (cells.high - cells.low)).all()
