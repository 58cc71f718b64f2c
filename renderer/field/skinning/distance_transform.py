"""How deep in the canonical body a place lies, so that of two places the one within can be told."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch.nn import functional

from renderer.field.networks.grid_interpolation import trilinear
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.skinning.inverse_skinning import WeightVolume
from scene.arrays import Float, Tensor

_FINER = 2
"""Grid points for each of the weight volume's: its likelihood is interpolated between them."""
_REACH = 8
"""Deepest depth that is told, in grid points: whatever lies deeper is as deep."""
_EDGE = 0.5
"""Likelihood at the rim of what may be body."""


@dataclass(frozen=True, eq=False)
class DistanceTransform(OccupancyGrid):
    """Distance (m) to the rim of what may be body, on a grid over the canonical box; nil outside.

    The rim lies as far above the skin everywhere, so depths compare as signed distances would.
    """

    metres: Float[Tensor, "G"]

    @classmethod
    def of(cls, volume: WeightVolume) -> DistanceTransform:
        """Euclidean distances, each axis in turn (Felzenszwalb and Huttenlocher 2012); parabolas
        are tried one by one as far as `_REACH`."""
        depth, height, width = volume.shape
        shape = (_FINER * depth - 1, _FINER * height - 1, _FINER * width - 1)
        device = volume.low.device
        axes = [
            torch.linspace(0.0, n - 1.0, m, device=device)
            for n, m in zip(volume.shape, shape, strict=True)
        ]
        z, y, x = torch.meshgrid(*axes, indexing="ij")
        at = torch.stack([x, y, z], dim=-1).view(-1, 3)
        likely = trilinear(volume.rows[:, :-1].sum(1, keepdim=True), at, volume.shape)
        inside = likely.view(shape) > _EDGE
        sides = (volume.high - volume.low) / torch.tensor(
            [shape[2] - 1.0, shape[1] - 1.0, shape[0] - 1.0], device=device
        )
        farthest = _REACH * float(sides.min())
        squared = inside.float() * farthest**2
        for axis, side in enumerate(reversed(sides.tolist())):
            squared = _nearer_along(squared, axis, side)
        return cls(volume.low, volume.high, shape, inside.view(-1), squared.sqrt().view(-1))

    def at(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """Depth of each point, m, as at the grid point below it."""
        return self.metres[self.index_of(points).long()]


def _nearer_along(
    squared: Float[Tensor, "D H W"], axis: int, side_m: float
) -> Float[Tensor, "D H W"]:
    """min over shifts s of squared(x + s) + s^2, beyond the border nil."""
    padding = [0] * 6
    padding[2 * (2 - axis)] = padding[2 * (2 - axis) + 1] = _REACH
    padded = functional.pad(squared, padding)
    nearest = squared
    for shift in range(-_REACH, _REACH + 1):
        moved = padded.narrow(axis, _REACH + shift, squared.shape[axis])
        nearest = torch.minimum(nearest, moved + (shift * side_m) ** 2)
    return nearest
