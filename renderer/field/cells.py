"""Which cells of a box can hold anything: one bit a cell, asked before anything else is.

A box of `side` grid points along each axis, corner to corner, x fastest; a cell carries the index
of its corner of lowest x, y and z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch.nn import functional

from scene.arrays import Bool, Float, Int, Tensor


@dataclass(frozen=True, eq=False)
class LiveCells:
    """Cells of a box, each live or not."""

    low: Float[Tensor, "3"]
    high: Float[Tensor, "3"]
    side: int
    live: Bool[Tensor, "G"]
    """Whether the cell above this grid point (towards +x, +y, +z) may hold anything to see."""

    @property
    def cell_m(self) -> Float[Tensor, "3"]:
        """Sides of a cell."""
        return (self.high - self.low) / (self.side - 1)

    def cell_coordinates(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """Grid coordinates of points."""
        return (points - self.low) / self.cell_m

    def index_of(self, points: Float[Tensor, "N 3"]) -> Int[Tensor, "N"]:
        """Index of the cell of each point; points outside go to the border."""
        cell = self.cell_coordinates(points).to(torch.int32).clamp_(0, self.side - 2)
        return (cell[:, 2] * self.side + cell[:, 1]) * self.side + cell[:, 0]

    def index_along(
        self,
        origins: Float[Tensor, "R 3"],
        directions: Float[Tensor, "R 3"],
        t: Float[Tensor, "R S"],
    ) -> Int[Tensor, "R S"]:
        """The same for places along rays, without making the points."""
        start, slope = (origins - self.low) / self.cell_m, directions / self.cell_m
        index = torch.zeros(t.shape, dtype=torch.int32, device=t.device)
        for axis, stride in ((2, self.side * self.side), (1, self.side), (0, 1)):
            at = torch.addcmul(start[:, axis : axis + 1], t, slope[:, axis : axis + 1])
            index += stride * at.to(torch.int32).clamp_(0, self.side - 2)
        return index

    @classmethod
    def near(
        cls,
        places: Float[Tensor, "P 3"],
        reach_m: float,
        box: tuple[Float[Tensor, "3"], Float[Tensor, "3"]],
        side: int,
    ) -> LiveCells:
        """Every cell of `box` with a point within `reach_m` of any of `places`, and few more."""
        nothing = torch.zeros(side**3, dtype=torch.bool, device=places.device)
        cells = cls(*box, side, nothing)
        marked = nothing.float()
        marked[cells.index_of(places).long()] = 1.0
        around = [1 + math.ceil(reach_m / float(cells.cell_m[axis])) for axis in (2, 1, 0)]
        live = dilated(marked.view(side, side, side), (around[0], around[1], around[2]))
        return cls(*box, side, live.view(-1) > 0.0)


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
