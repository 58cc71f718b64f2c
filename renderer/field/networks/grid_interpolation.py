"""Trilinear interpolation of rows of a table: the one primitive under every grid of the field.

A grid of shape (D, H, W) spans a box corner to corner: grid point (0, 0, 0) is the box's low
corner, (D-1, H-1, W-1) its high one, axes z, y, x. `embedding_bag` sums the eight weighted rows in
one pass, several times faster on a CPU than `grid_sample`, which does not run in parallel there.
"""

from __future__ import annotations

from typing import Any

import torch
from torch.nn import functional

from scene.arrays import Float, Int, Tensor

_CORNERS = tuple((dz, dy, dx) for dz in (0, 1) for dy in (0, 1) for dx in (0, 1))


def to_grid(
    points: Float[Tensor, "N 3"],
    low: Float[Tensor, "3"],
    high: Float[Tensor, "3"],
    shape: tuple[int, int, int],
) -> Float[Tensor, "N 3"]:
    """Continuous grid coordinates (x, y, z) of points (m) in a grid of `shape` over a box."""
    last = [shape[2] - 1, shape[1] - 1, shape[0] - 1]
    size = torch.tensor(last, dtype=low.dtype, device=low.device)
    return (points - low) * (size / (high - low))


def corners(
    at: Float[Tensor, "N 3"], shape: tuple[int, int, int]
) -> tuple[Int[Tensor, "N 8"], Float[Tensor, "N 8"]]:
    """Flat indices (int32) and weights of the eight grid points around grid coordinates.

    Coordinates outside are moved to the border. Weights are differentiable in `at`.
    """
    depth, height, width = shape
    top = torch.tensor([width - 1, height - 1, depth - 1], dtype=at.dtype, device=at.device)
    at = torch.minimum(at.clamp(min=0.0), top)
    cell = torch.minimum(at.detach().floor(), top - 1.0)
    share = at - cell
    x, y, z = (share[:, i : i + 1] for i in range(3))
    along_x = torch.cat([1.0 - x, x], dim=1)
    along_yx = torch.cat([along_x * (1.0 - y), along_x * y], dim=1)
    weights = torch.cat([along_yx * (1.0 - z), along_yx * z], dim=1)
    whole = cell.to(torch.int32)
    base = (whole[:, 2] * height + whole[:, 1]) * width + whole[:, 0]
    steps = [(dz * height + dy) * width + dx for dz, dy, dx in _CORNERS]
    return base[:, None] + torch.tensor(steps, dtype=torch.int32, device=at.device), weights


class _WeightedRows(torch.autograd.Function):
    """sum_j weights[n, j] * table[index[n, j]], with gradients for table and weights."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, index: Tensor, weights: Tensor) -> Tensor:
        ctx.save_for_backward(table, index, weights)
        return functional.embedding_bag(index, table, per_sample_weights=weights, mode="sum")

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, None, Tensor | None]:
        (grad,) = grads
        table, index, weights = ctx.saved_tensors
        for_table = for_weights = None
        if ctx.needs_input_grad[0]:
            rows = (weights[..., None] * grad[:, None]).view(-1, grad.shape[1])
            # 64-bit indices on purpose: with 32 bits index_add_ takes a path ten times slower
            for_table = torch.zeros_like(table).index_add_(0, index.reshape(-1).long(), rows)
        if ctx.needs_input_grad[2]:
            near = table.index_select(0, index.reshape(-1)).view(*index.shape, -1)
            for_weights = (near * grad[:, None]).sum(-1)
        return for_table, None, for_weights


def weighted_rows(
    table: Float[Tensor, "R C"], index: Int[Tensor, "N 8"], weights: Float[Tensor, "N 8"]
) -> Float[Tensor, "N C"]:
    """Rows of `table` summed with `weights`; first derivatives for table and weights."""
    if index.shape[0] == 0:
        return table.new_zeros(0, table.shape[1])
    return _WeightedRows.apply(table, index, weights)


def trilinear(
    table: Float[Tensor, "R C"], at: Float[Tensor, "N 3"], shape: tuple[int, int, int]
) -> Float[Tensor, "N C"]:
    """Interpolated rows of a dense grid (row = flat index) at grid coordinates."""
    return weighted_rows(table, *corners(at, shape))
