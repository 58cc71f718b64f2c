"""Which cells of a box can hold anything: one bit a cell, asked before anything else is.

A box of grid points, `shape` along z, y and x, corner to corner, x fastest; a cell carries the
index of its corner of lowest x, y and z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch.nn import functional

from scene.arrays import Bool, Float, Int, Tensor


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Cells of a box, each live or not."""

    low: Float[Tensor, "3"]
    high: Float[Tensor, "3"]
    shape: tuple[int, int, int]
    """Grid points along z, y and x."""
    live: Bool[Tensor, "G"]
    """Whether the cell above this grid point (towards +x, +y, +z) may hold anything to see."""

    @property
    def cell_m(self) -> Float[Tensor, "3"]:
        """Sides of a cell."""
        return (self.high - self.low) / (_extent(self.shape, self.low) - 1.0)

    def cell_coordinates(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """Grid coordinates of points."""
        return (points - self.low) / self.cell_m

    def index_of(self, points: Float[Tensor, "N 3"]) -> Int[Tensor, "N"]:
        """Index of the cell of each point; points outside go to the border."""
        last = _extent(self.shape, self.low) - 2.0
        cell = torch.minimum(self.cell_coordinates(points).clamp_(min=0.0), last).to(torch.int32)
        _, height, width = self.shape
        return (cell[:, 2] * height + cell[:, 1]) * width + cell[:, 0]

    def holds(self, points: Float[Tensor, "N 3"]) -> Bool[Tensor, "N"]:
        """Whether the cell of each point is live."""
        return self.live[self.index_of(points).long()]

    def index_along(
        self,
        origins: Float[Tensor, "R 3"],
        directions: Float[Tensor, "R 3"],
        t: Float[Tensor, "R S"],
    ) -> Int[Tensor, "R S"]:
        """The same for places along rays, without making the points."""
        start, slope = (origins - self.low) / self.cell_m, directions / self.cell_m
        index = torch.zeros(t.shape, dtype=torch.int32, device=t.device)
        depth, height, width = self.shape
        for axis, count, stride in ((2, depth, height * width), (1, height, width), (0, width, 1)):
            at = torch.addcmul(start[:, axis : axis + 1], t, slope[:, axis : axis + 1])
            index += stride * at.to(torch.int32).clamp_(0, count - 2)
        return index

    @classmethod
    def near(
        cls,
        places: Float[Tensor, "P 3"],
        reach_m: float,
        box: tuple[Float[Tensor, "3"], Float[Tensor, "3"]],
        shape: tuple[int, int, int],
    ) -> OccupancyGrid:
        """Every cell of `box` with a point within `reach_m` of any of `places`, and few more."""
        marked = torch.zeros(math.prod(shape), device=places.device)
        cells = cls(*box, shape, marked > 0.0)
        marked[cells.index_of(places).long()] = 1.0
        return replace(cells, live=marked > 0.0).grown(reach_m)

    def grown(self, by_m: float) -> OccupancyGrid:
        """Live cells and all that have a point within `by_m` of theirs, and few more."""
        x, y, z = (1 + math.ceil(by_m / float(side)) for side in self.cell_m)
        live = dilated(self.live.view(self.shape).float(), (z, y, x))
        return replace(self, live=live.view(-1) > 0.0)

    def points_of_live(self) -> Float[Tensor, "L 3"]:
        """Low corners of the live cells."""
        return self.corner(torch.nonzero(self.live)[:, 0])

    def corner(self, index: Int[Tensor, "N"]) -> Float[Tensor, "N 3"]:
        """Low corners of cells, by their index."""
        _, height, width = self.shape
        at = torch.stack([index % width, index // width % height, index // (height * width)], dim=1)
        return self.low + at * self.cell_m


def cells_a_side(
    low: Float[Tensor, "3"], high: Float[Tensor, "3"], cell_m: float
) -> tuple[int, int, int]:
    """Grid points along z, y and x for cells of about `cell_m` a side."""
    x, y, z = (2 + int(side / cell_m) for side in (high - low).tolist())
    return z, y, x


def _extent(shape: tuple[int, int, int], like: Tensor) -> Float[Tensor, "3"]:
    depth, height, width = shape
    return torch.tensor([width, height, depth], dtype=like.dtype, device=like.device)


def dilated(
    values: Float[Tensor, "D H W"], by: tuple[int, int, int] = (1, 1, 1)
) -> Float[Tensor, "D H W"]:
    """The largest value within `by` cells along each axis."""
    made = values[None, None]
    for axis, reach in enumerate(by):
        window, padding = [1, 1, 1], [0, 0, 0]
        window[axis], padding[axis] = 2 * reach + 1, reach
        made = functional.max_pool3d(made, window, stride=1, padding=padding)
    return made[0, 0]


def largest_part(filled: Bool[Tensor, "D H W"]) -> Bool[Tensor, "D H W"]:
    """The cells of the largest connected part (cells that share a corner belong together)."""
    if not bool(filled.any()):
        return filled
    mask = filled.float()
    # every cell takes the largest number of its part, which its neighbours pass on; numbers stay
    # exact in single precision up to 2^24 cells
    numbers = torch.arange(1, mask.numel() + 1, device=mask.device).view(mask.shape) * mask
    while True:
        spread = dilated(numbers) * mask
        if torch.equal(spread, numbers):
            break
        numbers = spread
    names, counts = numbers[filled].unique(return_counts=True)
    return numbers == names[counts.argmax()]
