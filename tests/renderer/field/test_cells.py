"""Live cells and connected parts, against brute force."""

from __future__ import annotations

import torch

from renderer.field.rendering.occupancy_grid import (
    OccupancyGrid,
    cells_a_side,
    dilated,
    largest_part,
)

LOW, HIGH = torch.tensor([0.0, 0.0, 0.0]), torch.tensor([1.0, 2.0, 0.5])


def test_every_point_in_reach_lies_in_a_live_cell():
    generator = torch.Generator().manual_seed(0)
    places = LOW + torch.rand(5, 3, generator=generator) * (HIGH - LOW)
    cells = OccupancyGrid.near(places, 0.07, (LOW, HIGH), (9, 30, 16))
    points = LOW + torch.rand(20_000, 3, generator=generator) * (HIGH - LOW)
    in_reach = torch.cdist(points, places).amin(dim=1) < 0.07
    live = cells.live[cells.index_of(points).long()]
    assert in_reach.any()
    assert live[in_reach].all()
    assert live.float().mean() < 0.6


def test_places_along_rays_agree_with_points():
    cells = OccupancyGrid(LOW, HIGH, (6, 9, 8), torch.zeros(432, dtype=torch.bool))
    origins, directions = torch.tensor([[-0.2, 0.3, 0.1]]), torch.tensor([[0.8, 0.6, 0.1]])
    t = torch.linspace(0.0, 2.0, 33)[None]
    points = origins + t.view(-1, 1) * directions
    assert torch.equal(cells.index_along(origins, directions, t)[0], cells.index_of(points))


def test_live_cells_lie_where_their_corners_say():
    shape = cells_a_side(LOW, HIGH, 0.1)
    assert shape == (7, 22, 12)
    cells = OccupancyGrid.near(torch.tensor([[0.52, 1.03, 0.21]]), 0.0, (LOW, HIGH), shape)
    assert (cells.cell_m <= 0.1).all()
    middles = cells.points_of_live() + 0.5 * cells.cell_m
    assert cells.holds(middles).all()
    assert len(middles) == 27  # its own cell and those around it
    assert len(cells.grown(0.05).points_of_live()) == 7 * 7 * 6  # the box ends along z


def test_dilation_takes_the_largest_neighbour():
    values = torch.zeros(5, 5, 5)
    values[2, 2, 2] = 3.0
    assert dilated(values)[1, 3, 1] == 3.0
    assert dilated(values).sum() == 27 * 3.0
    assert dilated(values, (2, 0, 0)).sum() == 5 * 3.0


def test_the_largest_part_stays():
    filled = torch.zeros(9, 9, 9, dtype=torch.bool)
    filled[1:4, 1:4, 1:4] = True
    filled[4, 4, 4] = True  # hangs on by a corner
    filled[7, 7, 6:8] = True
    kept = largest_part(filled)
    assert int(kept.sum()) == 28
    assert kept[4, 4, 4]
    assert not kept[7].any()


def test_nothing_has_no_part():
    nothing = torch.zeros(3, 3, 3, dtype=torch.bool)
    assert not largest_part(nothing).any()
