"""What a trained field holds, found once: floaters go, and emptiness is known from then on.

A floater is density apart from the person: it was seen from too few sides to be carved away. The
person is the largest connected part.
"""

from __future__ import annotations

import torch
from torch.nn import functional

from renderer.field.canonical import CanonicalField
from renderer.field.cells import LiveCells, dilated, largest_part
from renderer.field.skinning import WeightVolume
from scene.arrays import Bool, Float, Tensor

LEAST_DENSITY = 2.0
"""1/m: below, a centimetre hides 2 % of what is behind it."""
_SIDE = 64
_POINTS_AT_ONCE = 65536
_NIL = 1e-5
_APART_M = 0.024
"""Parts of a field's own grid that are nearer than this are one."""


@torch.no_grad()
def occupied_cells(canonical: CanonicalField, volume: WeightVolume) -> LiveCells:
    """Cells of the canonical box that belong to the person, with a border of one cell.

    Asks a field without a grid at the grid points where any bone has a say. All cells, where
    nothing is found.
    """
    axes = [torch.linspace(float(volume.low[a]), float(volume.high[a]), _SIDE) for a in range(3)]
    z, y, x = torch.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = torch.stack([x, y, z], dim=-1).view(-1, 3)
    asked = torch.nonzero(volume.at(points).sum(dim=1) > _NIL)[:, 0]
    density = torch.zeros(len(points))
    for part in asked.split(_POINTS_AT_ONCE):
        density[part] = canonical(points[part])[1]
    filled = (density > LEAST_DENSITY).view(_SIDE, _SIDE, _SIDE)
    # a cell is live where any of its corners is, and so are those around it: one cell of border
    live = dilated(largest_part(filled).float()) > 0.0
    if not bool(live.any()):
        live = torch.ones_like(live)
    return LiveCells(volume.low, volume.high, _SIDE, live.view(-1))


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
