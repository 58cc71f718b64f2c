"""CanonicalField: colour and density of a canonical place, without view direction.

Either an MLP over a positional encoding, as in the paper, or a grid of features in a shell around
the rest surface with a small MLP for colour behind it (`GridSize`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from renderer.devices import on_device
from renderer.field.networks.encoding import encoded_size, positional_encoding
from renderer.field.networks.grid_interpolation import corners, to_grid, trilinear, weighted_rows
from renderer.field.networks.mlps import Mlp
from renderer.field.sizes import FieldSizes, GridSize
from renderer.field.skinning.rest_shape import RestShape
from scene.arrays import Array, Bool, Float, Int, Tensor

DENSITY_SCALE = 100.0
"""1/m a unit of what is learnt: a centimetre of skin is then opaque at moderate parameters."""
START_DENSITY = 10.0
"""1/m, added before an MLP's ReLU: every run starts as a fog, a body's width of which is nearly
opaque, and not as a black picture, where the ReLU would pass no gradient."""
_SOFTNESS_M = 0.006
"""Signed distance that changes the first density by one unit of its logit."""
_LOGIT_RANGE = (-8.0, 5.0)
_EMPTY, _DEEP, _FIXED_ROWS = 0, 1, 2
_EMPTY_LOGIT, _DEEP_LOGIT = -12.0, 5.0


@dataclass(frozen=True, eq=False)
class NarrowBand:
    """Which grid points of the canonical box are learnt."""

    learnt: Bool[Array, "D H W"]
    deep: Bool[Array, "D H W"]
    """Below the shell: opaque and not learnt. Everywhere else is empty."""

    @classmethod
    def around(cls, shape: RestShape, size: GridSize) -> tuple[NarrowBand, Float[Array, "D H W"]]:
        """The shell around the expected skin, and the signed distance at its grid points."""
        count = np.rint((shape.high - shape.low) / size.voxel_m).astype(int) + 1
        distance = _resampled(shape.signed_distance, (int(count[2]), int(count[1]), int(count[0])))
        deep = distance < -size.inside_m
        return cls(~deep & (distance <= size.outside_m + size.voxel_m), deep), distance

    @property
    def rows(self) -> Int[Array, "D H W"]:
        """Row of the table for each grid point, int32."""
        rows = np.where(self.deep, _DEEP, _EMPTY).astype(np.int32)
        rows[self.learnt] = _FIXED_ROWS + np.arange(int(self.learnt.sum()), dtype=np.int32)
        return rows


@dataclass(frozen=True, eq=False)
class InterpolationPoints:
    """Canonical points with the grid rows and weights that interpolate there, where there is a
    grid."""

    points: Float[Tensor, "N 3"]
    index: Int[Tensor, "N 8"] | None
    weights: Float[Tensor, "N _"]

    def kept(self, keep: Bool[Tensor, "N"]) -> InterpolationPoints:
        """Only the points marked."""
        index = None if self.index is None else self.index[keep]
        return InterpolationPoints(self.points[keep], index, self.weights[keep])


class CanonicalField(nn.Module):
    """Colour in [0, 1] and density >= 0 (1/m) of canonical points."""

    low: Tensor
    high: Tensor
    rows: Tensor

    def __init__(
        self,
        sizes: FieldSizes,
        low: Float[Tensor, "3"],
        high: Float[Tensor, "3"],
        shell: NarrowBand | None = None,
    ) -> None:
        super().__init__()
        self._octaves = sizes.octaves
        self.register_buffer("low", low, persistent=False)
        self.register_buffer("high", high, persistent=False)
        self.table: nn.Parameter | None = None
        self.mlp: Mlp | None = None
        if sizes.grid is None or shell is None:
            assert sizes.colour is not None
            inputs = encoded_size(sizes.octaves, identity=True)
            self.mlp = Mlp(inputs, 4, sizes.colour, backend=sizes.backend)
            return
        if sizes.colour is not None:
            self.mlp = Mlp(sizes.grid.channels, 3, sizes.colour, backend=sizes.backend)
        depth, height, width = shell.learnt.shape
        self._shape = (depth, height, width)
        self.register_buffer("rows", torch.from_numpy(shell.rows.reshape(-1)), persistent=False)
        count = int(shell.learnt.sum()) + _FIXED_ROWS
        table = 0.01 * torch.randn(count, 1 + sizes.grid.channels)
        table[:_FIXED_ROWS] = 0.0
        table[_EMPTY, 0], table[_DEEP, 0] = _EMPTY_LOGIT, _DEEP_LOGIT
        self.table = nn.Parameter(table)
        self.table.register_hook(_keep_fixed_rows)

    @property
    def has_grid(self) -> bool:
        """Whether density can be read without colour."""
        return self.table is not None

    def start_from(self, shell: NarrowBand, signed_distance: Float[Array, "D H W"]) -> None:
        """Start with density where the skin is expected: no run begins black or as a fog."""
        assert self.table is not None
        logit = np.clip(-signed_distance[shell.learnt] / _SOFTNESS_M, *_LOGIT_RANGE)
        with torch.no_grad():
            self.table[_FIXED_ROWS:, 0] = on_device(logit, self.table.device, torch.float32)

    def forward(
        self, points: Float[Tensor, "N 3"]
    ) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
        """Colours and densities."""
        return self.at(self.located(points))

    def located(self, points: Float[Tensor, "N 3"]) -> InterpolationPoints:
        """Where points lie in the field, worked out once for `density_at` and `at`."""
        if self.table is None:
            return InterpolationPoints(points, None, points)
        index, weights = corners(to_grid(points, self.low, self.high, self._shape), self._shape)
        return InterpolationPoints(points, self.rows[index], weights)

    def at(self, place: InterpolationPoints) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
        """Colours and densities."""
        if self.table is None or place.index is None:
            assert self.mlp is not None
            out = self.mlp(positional_encoding(place.points, self._octaves, identity=True))
            return torch.sigmoid(out[:, :3]), functional.relu(
                DENSITY_SCALE * out[:, 3] + START_DENSITY
            )
        features = weighted_rows(self.table, place.index, place.weights)
        colour = features[:, 1:] if self.mlp is None else self.mlp(features[:, 1:])
        return torch.sigmoid(colour), _density(features[:, 0])

    def may_hold(self, points: Float[Tensor, "N 3"]) -> Bool[Tensor, "N"]:
        """Whether anything learnt lies next to a point; True everywhere without a grid."""
        if self.table is None:
            return torch.ones(len(points), dtype=torch.bool, device=points.device)
        at = to_grid(points, self.low, self.high, self._shape)
        index, _ = corners(at, self._shape)
        return (self.rows[index] >= _FIXED_ROWS).any(dim=1)

    def grid_density(self) -> Float[Tensor, "D H W"]:
        """Densities at the grid's own points."""
        assert self.table is not None
        return _density(self.table[self.rows.long(), 0]).view(self._shape)

    def empty(self, there: Bool[Tensor, "D H W"]) -> None:
        """Take all density from the grid points marked."""
        assert self.table is not None
        rows = self.rows[there.view(-1)].long()
        with torch.no_grad():
            self.table[rows[rows >= _FIXED_ROWS], 0] = _EMPTY_LOGIT

    def density_at(self, place: InterpolationPoints) -> Float[Tensor, "N"]:
        """Densities alone; a fraction of the price of `at` where a grid holds them."""
        if self.table is None or place.index is None:
            return self.at(place)[1]
        logits = self.table[:, :1].contiguous()
        return _density(weighted_rows(logits, place.index, place.weights)[:, 0])


def _density(logit: Float[Tensor, "N"]) -> Float[Tensor, "N"]:
    return DENSITY_SCALE * functional.softplus(logit)


def _keep_fixed_rows(grad: Tensor) -> Tensor:
    return torch.cat([torch.zeros_like(grad[:_FIXED_ROWS]), grad[_FIXED_ROWS:]])


def _resampled(values: Float[Array, "d h w"], shape: tuple[int, int, int]) -> Float[Array, "D H W"]:
    """`values` on a grid of another shape over the same box."""
    depth, height, width = values.shape
    axes = [
        torch.linspace(0.0, have - 1.0, want)
        for have, want in zip((depth, height, width), shape, strict=True)
    ]
    z, y, x = torch.meshgrid(*axes, indexing="ij")
    at = torch.stack([x, y, z], dim=-1).view(-1, 3)
    table = torch.from_numpy(np.ascontiguousarray(values.reshape(-1, 1)))
    return trilinear(table, at, (depth, height, width)).view(shape).numpy()
