"""What a trained field holds, found once: floaters go, and emptiness is known from then on.

A floater is density apart from the person: it was seen from too few sides to be carved away. The
person is the largest connected part.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch.nn import functional

from renderer.field.networks.canonical import CanonicalField
from renderer.field.rendering.occupancy_grid import (
    OccupancyGrid,
    cells_a_side,
    dilated,
    largest_part,
)
from renderer.field.skinning.inverse_skinning import WeightVolume
from scene.arrays import Bool, Float, Tensor

LEAST_DENSITY = 2.0
"""1/m: below, a centimetre hides 2 % of what is behind it."""
_CELL_M = 0.012
_COARSE = 3
"""Cells that are asked first, in cells: finer ones only where those hold anything."""
_POINTS_AT_ONCE = 65536
_NIL = 1e-5
_APART_M = 0.024
"""Parts of a field's own grid that are nearer than this are one."""


@torch.no_grad()
def occupied_cells(canonical: CanonicalField, volume: WeightVolume) -> OccupancyGrid:
    """Cells of the canonical box that belong to the person, with a border of one cell.

    Asks a field without a grid at the grid points where any bone has a say, coarsely and then,
    about what was found, finely. All cells, where nothing is found.
    """
    low, high = volume.low, volume.high
    few = cells_a_side(low, high, _COARSE * _CELL_M)
    everywhere = torch.ones(few, dtype=torch.bool, device=low.device)
    person = largest_part(
        _filled(canonical, volume, OccupancyGrid(low, high, few, everywhere.view(-1)))
    )
    if not bool(person.any()):
        person = everywhere
    near = _with_border(person)[:-1, :-1, :-1]
    for axis in range(3):
        near = near.repeat_interleave(_COARSE, dim=axis)
    near = functional.pad(near, (0, 1) * 3)
    many = (near.shape[0], near.shape[1], near.shape[2])
    cells = OccupancyGrid(low, high, many, near.reshape(-1))
    filled = _filled(canonical, volume, cells)
    return replace(cells, live=_with_border(filled).view(-1)) if bool(filled.any()) else cells


def _filled(
    canonical: CanonicalField, volume: WeightVolume, asked: OccupancyGrid
) -> Bool[Tensor, "D H W"]:
    """Which low corners of the cells `asked` hold a density."""
    index = torch.nonzero(asked.live)[:, 0]
    points = asked.corner(index)
    likely = volume.at(points).sum(dim=1) > _NIL
    index, points = index[likely], points[likely]
    density = torch.zeros(len(asked.live), device=points.device)
    for part, places in zip(
        index.split(_POINTS_AT_ONCE), points.split(_POINTS_AT_ONCE), strict=True
    ):
        density[part] = canonical(places)[1]
    return (density > LEAST_DENSITY).view(asked.shape)


def _with_border(filled: Bool[Tensor, "D H W"]) -> Bool[Tensor, "D H W"]:
    """A cell is live where any of its corners is, and so are those around it."""
    return dilated(filled.float()) > 0.0


@torch.no_grad()
def prune_grid(canonical: CanonicalField, deep: Bool[Tensor, "D H W"]) -> int:
    """Empty what a field's own grid holds apart from the person; returns how many grid points."""
    density = canonical.grid_density()
    voxel_m = float((canonical.high - canonical.low)[2]) / (len(density) - 1)
    coarse = max(1, round(_APART_M / voxel_m))
    filled = _pooled(((density > LEAST_DENSITY) | deep).float(), coarse) > 0.0
    kept = dilated(largest_part(filled).float())
    for axis in range(3):
        kept = kept.repeat_interleave(coarse, dim=axis)
    depth, height, width = density.shape
    apart = (kept[:depth, :height, :width] == 0.0) & (density > LEAST_DENSITY) & ~deep
    canonical.empty(apart)
    return int(apart.sum())


def _pooled(values: Float[Tensor, "D H W"], coarse: int) -> Float[Tensor, "d h w"]:
    return functional.max_pool3d(values[None, None], coarse, coarse, ceil_mode=True)[0, 0]
