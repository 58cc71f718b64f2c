"""Trilinear look-ups against torch's own, and their gradients."""

from __future__ import annotations

import torch
from torch.nn import functional

from renderer.field.networks.grid_interpolation import corners, to_grid, trilinear, weighted_rows

SHAPE = (4, 5, 6)


def _table(channels: int = 3) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.rand(4 * 5 * 6, channels, generator=generator, dtype=torch.float64)


def test_agrees_with_grid_sample():
    table, unit = _table(), torch.rand(50, 3, dtype=torch.float64) * 2.0 - 1.0
    low, high = torch.full((3,), -1.0).double(), torch.ones(3).double()
    got = trilinear(table, to_grid(unit, low, high, SHAPE), SHAPE)
    volume = table.T.reshape(1, 3, *SHAPE)
    expected = functional.grid_sample(
        volume, unit.view(1, 1, 1, -1, 3), padding_mode="border", align_corners=True
    )
    assert torch.allclose(got, expected.view(3, -1).T)


def test_grid_points_give_their_own_row():
    table = _table()
    got = trilinear(table, torch.tensor([[5.0, 4.0, 3.0], [0.0, 0.0, 0.0]]).double(), SHAPE)
    assert torch.allclose(got, table[[-1, 0]])


def test_outside_takes_the_border():
    table = _table()
    got = trilinear(table, torch.tensor([[99.0, 99.0, 99.0]]).double(), SHAPE)
    assert torch.allclose(got, table[-1:])


def test_gradients_of_table_and_places():
    table = _table(2).requires_grad_(True)
    at = (torch.rand(6, 3, dtype=torch.float64) * 3.0 + 0.1).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda t, a: trilinear(t, a, SHAPE), (table, at))


def test_no_points_no_rows():
    index, weights = corners(torch.zeros(0, 3), SHAPE)
    assert weighted_rows(_table().float(), index, weights).shape == (0, 3)
