"""A body in one pose, ready to be asked "which canonical point is here?".

The paper's way costs 24 look-ups a sample. `reached_cells` says, exactly, where all of them would
find nothing. `renderer.field.skinning.posed_grid` caches them once a pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch

from renderer.field.field import PersonField
from renderer.field.rendering.occupancy_grid import OccupancyGrid, cells_a_side, dilated
from renderer.field.skinning.distance_transform import DistanceTransform
from renderer.field.skinning.inverse_skinning import (
    WeightVolume,
    blended_inverse,
    inverse_skinning,
    reached_skinning,
)
from scene.arrays import Bool, Float, Tensor

LEAST_LIKELIHOOD = 1e-3
"""Samples less likely than this belong to nobody: alpha would be below it too."""
_NIL_WEIGHT = 1e-5
"""Weight below which a joint has no say: all 24 together stay far below the likelihood above."""
_REACHED_CELL_M = 0.02
_SUPPORT_LIKELIHOOD = 0.25
_SUPPORT_POINTS = 6000
_BOX_MARGIN_M = 0.03
_RESIDUAL_SAMPLES = 4096
_RESIDUAL_MARGIN = 1.5
"""How much further the residual may reach between the places where it was asked."""


@dataclass(frozen=True, eq=False)
class Support:
    """Places of the canonical body, enough of them to bound it in any pose."""

    points: Float[Tensor, "P 3"]
    weights: Float[Tensor, "P K"]
    bone_low: Float[Tensor, "K 3"]
    """Canonical box in which joint k moves anything, m; empty (low > high) for none."""
    bone_high: Float[Tensor, "K 3"]
    moved: tuple[Float[Tensor, "_ 3"], ...]
    """Centres of the canonical cells in which joint k moves anything, m."""
    cell_radius_m: float
    """From a canonical cell's centre to its corners."""
    volume: WeightVolume

    @cached_property
    def depths(self) -> DistanceTransform:
        """How deep in the body places lie."""
        return DistanceTransform.of(self.volume)

    @classmethod
    def of(cls, volume: WeightVolume) -> Support:
        """Read off the weight volume."""
        depth, height, width = volume.shape
        device = volume.low.device
        axes = [torch.linspace(0.0, 1.0, n, device=device) for n in (depth, height, width)]
        z, y, x = torch.meshgrid(*axes, indexing="ij")
        unit = torch.stack([x, y, z], dim=-1).view(-1, 3)
        places = volume.low + unit * (volume.high - volume.low)
        weights = volume.rows[:, :-1]
        sides = torch.tensor([width - 1.0, height - 1.0, depth - 1.0], device=device)
        cell = (volume.high - volume.low) / sides
        nowhere = torch.full((3,), torch.inf, device=device)
        lows, highs, centres = [], [], []
        for joint in range(weights.shape[1]):
            some = weights[:, joint] > _NIL_WEIGHT
            moved = places[some]
            lows.append(moved.amin(0) - cell if len(moved) else nowhere)
            highs.append(moved.amax(0) + cell if len(moved) else -nowhere)
            live = live_cells(some.float().view(volume.shape))
            centres.append(places[live] + 0.5 * cell)
        body = torch.nonzero(weights.sum(dim=1) > _SUPPORT_LIKELIHOOD)[:, 0]
        picked = body[:: max(1, len(body) // _SUPPORT_POINTS)]
        share = weights[picked] / weights[picked].sum(dim=1, keepdim=True)
        box = torch.stack(lows), torch.stack(highs)
        radius = 0.5 * float(cell.norm())
        return cls(places[picked], share, *box, tuple(centres), radius, volume)

    def bounds(
        self, transforms: Float[Tensor, "K 3 4"]
    ) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
        """Low and high corner (world, m) of the posed body with its shell."""
        blend = (self.weights @ transforms.reshape(-1, 12)).view(-1, 3, 4)
        posed = (blend[:, :, :3] @ self.points[:, :, None])[..., 0] + blend[:, :, 3]
        return posed.amin(0) - _BOX_MARGIN_M, posed.amax(0) + _BOX_MARGIN_M


def reached_cells(support: Support, transforms: Float[Tensor, "K 3 4"]) -> OccupancyGrid:
    """Cells of the posed body's box that any joint's weights reach; nobody is anywhere else."""
    centres = [
        moved @ transform[:, :3].T + transform[:, 3]
        for moved, transform in zip(support.moved, transforms, strict=True)
    ]
    box = support.bounds(transforms)
    everywhere = torch.cat(centres)
    near = support.cell_radius_m
    inside = ((everywhere > box[0] - near) & (everywhere < box[1] + near)).all(dim=1)
    return OccupancyGrid.near(everywhere[inside], near, box, cells_a_side(*box, _REACHED_CELL_M))


@torch.no_grad()
def occupied_before_residual(
    field: PersonField, joint_angles: Float[Tensor, "K 3"]
) -> OccupancyGrid | None:
    """Canonical cells out of which this pose's residual may carry a point into an occupied one;
    None where occupation is not known."""
    occupied = field.occupied
    if occupied is None or field.residual is None or field.residual_opened is None:
        return occupied
    places = occupied.points_of_live()
    places = places[:: max(1, len(places) // _RESIDUAL_SAMPLES)]
    moved = (field.moved(places, joint_angles) - places).norm(dim=1)
    return occupied.grown(_RESIDUAL_MARGIN * float(moved.max())) if len(moved) else occupied


@torch.no_grad()
def occupied_cells(
    field: PersonField,
    volume: WeightVolume,
    support: Support,
    transforms: Float[Tensor, "K 3 4"],
    joint_angles: Float[Tensor, "K 3"],
    before: OccupancyGrid | None,
) -> OccupancyGrid:
    """Cells of the posed body's box that the person fills, and those around them.

    Grid points ask where they come from; the canonical space knows what is there: `before` (of
    `occupied_before_residual`) roughly, then exactly. Its own border and one cell of border here
    make up for what lies between grid points.
    """
    cells = reached_cells(support, transforms)
    if before is None:
        return cells
    asked = torch.nonzero(cells.live)[:, 0]
    rounds = field.sizes.inverse_rounds
    found, likelihood = direct_canonical(cells.corner(asked), transforms, volume, rounds, support)
    likely = (likelihood > LEAST_LIKELIHOOD) & before.holds(found)
    filled = torch.zeros(len(cells.live), device=asked.device)
    there = field.occupied_at(field.moved(found[likely], joint_angles))
    assert there is not None
    filled[asked[likely]] = there.float()
    near = dilated(filled.view(cells.shape))
    return replace(cells, live=live_cells(near) & cells.live)


def live_cells(alive: Float[Tensor, "D H W"]) -> Bool[Tensor, "G"]:
    """Cells with any corner alive, at the index of their low corner."""
    padded = torch.nn.functional.pad(alive[None, None], (0, 1) * 3)
    return (torch.nn.functional.max_pool3d(padded, 2, stride=1) > 0.0).view(-1)


def direct_canonical(
    points: Float[Tensor, "N 3"],
    transforms: Float[Tensor, "K 3 4"],
    volume: WeightVolume,
    rounds: int,
    support: Support | None = None,
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
    """The same without a grid, differentiable, then `rounds` exact rounds.

    All joints are asked about every point, or with `support` only those whose weights reach it.
    """
    if support is None:
        canonical, likelihood = inverse_skinning(points, transforms, volume)
    else:
        boxes = support.bone_low, support.bone_high
        canonical, likelihood = reached_skinning(points, transforms, volume, boxes)
    for _ in range(rounds):
        canonical = blended_inverse(points, transforms, volume.at(canonical.detach()))
    return canonical, likelihood
