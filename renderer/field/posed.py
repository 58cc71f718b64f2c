"""A body in one pose, ready to be asked "which canonical point is here?".

The paper's way costs 24 look-ups a sample. `reached_cells` says, exactly, where all of them would
find nothing. A `PosedGrid` caches them once a pose: canonical point and likelihood on a grid over
the body's box, interpolated, plus one bit a cell that says whether anything is there at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from renderer.field.cells import LiveCells, cells_a_side, dilated
from renderer.field.field import PersonField
from renderer.field.lookup import corners, weighted_rows
from renderer.field.skinning import (
    WeightVolume,
    blended_inverse,
    inverse_skinning,
    reached_skinning,
)
from scene.arrays import Bool, Float, Int, Tensor

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
_TORN_ROUNDS = 2
_TORN_STRETCH = 1.5
"""A cell is torn when its corners' canonical points span this many of its own diagonals."""


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
            live = _live_cells(some.float().view(volume.shape))
            centres.append(places[live] + 0.5 * cell)
        body = torch.nonzero(weights.sum(dim=1) > _SUPPORT_LIKELIHOOD)[:, 0]
        picked = body[:: max(1, len(body) // _SUPPORT_POINTS)]
        share = weights[picked] / weights[picked].sum(dim=1, keepdim=True)
        box = torch.stack(lows), torch.stack(highs)
        radius = 0.5 * float(cell.norm())
        return cls(places[picked], share, *box, tuple(centres), radius)

    def bounds(
        self, transforms: Float[Tensor, "K 3 4"]
    ) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
        """Low and high corner (world, m) of the posed body with its shell."""
        blend = (self.weights @ transforms.reshape(-1, 12)).view(-1, 3, 4)
        posed = (blend[:, :, :3] @ self.points[:, :, None])[..., 0] + blend[:, :, 3]
        return posed.amin(0) - _BOX_MARGIN_M, posed.amax(0) + _BOX_MARGIN_M


def reached_cells(support: Support, transforms: Float[Tensor, "K 3 4"]) -> LiveCells:
    """Cells of the posed body's box that any joint's weights reach; nobody is anywhere else."""
    centres = [
        moved @ transform[:, :3].T + transform[:, 3]
        for moved, transform in zip(support.moved, transforms, strict=True)
    ]
    box = support.bounds(transforms)
    everywhere = torch.cat(centres)
    near = support.cell_radius_m
    inside = ((everywhere > box[0] - near) & (everywhere < box[1] + near)).all(dim=1)
    return LiveCells.near(everywhere[inside], near, box, cells_a_side(*box, _REACHED_CELL_M))


@torch.no_grad()
def occupied_before_residual(
    field: PersonField, joint_angles: Float[Tensor, "K 3"]
) -> LiveCells | None:
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
    field: PersonField, volume: WeightVolume, support: Support, transforms: Float[Tensor, "K 3 4"],
    joint_angles: Float[Tensor, "K 3"], before: LiveCells | None,
) -> LiveCells:  # fmt: skip
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
    return replace(cells, live=_live_cells(near) & cells.live)


@dataclass(frozen=True, eq=False)
class PosedGrid(LiveCells):
    """Canonical point and likelihood over the posed body's box; grid points span corner to
    corner."""

    rows: Float[Tensor, "G 4"]
    """Canonical point times likelihood, then likelihood: so that places without a canonical point
    do not pull their neighbours when rows are interpolated."""
    torn: Bool[Tensor, "G"]
    """Whether that cell's corners belong to places far apart in the canonical body, as between an
    arm and the side it rests on: nothing in between means anything there."""
    transforms: Float[Tensor, "K 3 4"]
    volume: WeightVolume

    def canonical(
        self, points: Float[Tensor, "N 3"]
    ) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
        """Canonical points and likelihoods, interpolated; in torn cells, solved for anew."""
        index, weights = corners(self.cell_coordinates(points), self.shape)
        rows = weighted_rows(self.rows, index, weights)
        likelihood = rows[:, 3]
        found = rows[:, :3] / likelihood.clamp(min=1e-6)[:, None]
        torn = torch.nonzero(self.torn[index[:, 0]])[:, 0]
        if len(torn):
            found[torn] = self._solved(points[torn], index[torn], weights[torn])
        return found, likelihood

    def _solved(self, points: Tensor, index: Tensor, weights: Tensor) -> Float[Tensor, "N 3"]:
        """From the canonical point of the nearest corner that has one, by fixed-point rounds."""
        near = self.rows[index]
        best = (weights * (near[..., 3] > LEAST_LIKELIHOOD)).argmax(dim=1)
        start = near[torch.arange(len(near), device=near.device), best]
        found = start[:, :3] / start[:, 3:].clamp(min=1e-6)
        for _ in range(_TORN_ROUNDS):
            found = blended_inverse(points, self.transforms, self.volume.at(found))
        return found


@torch.no_grad()
def posed_grid(
    field: PersonField,
    volume: WeightVolume,
    support: Support,
    transforms: Float[Tensor, "K 3 4"],
) -> PosedGrid:
    """The grid of one pose. Each joint is asked only about the part of the grid it can reach."""
    side = field.sizes.posed_grid
    low, high = support.bounds(transforms)
    device = low.device
    axes = [torch.linspace(float(low[a]), float(high[a]), side, device=device) for a in range(3)]
    total = torch.zeros(side, side, side, device=device)
    moved = torch.zeros(side, side, side, 3, device=device)
    for joint in range(len(transforms)):
        window = _reached(support, joint, transforms[joint], axes)
        if window is None:
            continue
        z, y, x = torch.meshgrid(*(axes[a][window[2 - a]] for a in (2, 1, 0)), indexing="ij")
        points = torch.stack([x, y, z], dim=-1).view(-1, 3)
        rotation, offset = transforms[joint, :, :3], transforms[joint, :, 3]
        near = (points - offset) @ rotation
        inside = torch.nonzero(
            ((near >= support.bone_low[joint]) & (near <= support.bone_high[joint])).all(dim=1)
        )[:, 0]
        near = near[inside]
        weight = volume.of_joint(joint, near)
        flat = torch.zeros(len(points), 4, device=device)
        flat[inside] = torch.cat([weight[:, None] * near, weight[:, None]], dim=1)
        block = flat.view(*x.shape, 4)
        moved[window] += block[..., :3]
        total[window] += block[..., 3]
    likelihood = total.view(-1).clamp(max=1.0)
    canonical = moved.view(-1, 3) / total.view(-1, 1).clamp(min=1e-4)
    some = torch.nonzero(likelihood > LEAST_LIKELIHOOD)[:, 0]
    z, y, x = some // (side * side), some // side % side, some % side
    world = torch.stack([axes[0][x], axes[1][y], axes[2][z]], dim=1)
    found = canonical[some]
    for _ in range(field.sizes.inverse_rounds):
        found = blended_inverse(world, transforms, volume.at(found))
    rows = torch.zeros(side**3, 4, device=device)
    rows[some] = torch.cat([found, torch.ones_like(found[:, :1])], dim=1) * likelihood[some, None]
    alive = torch.zeros(side**3, device=device)
    alive[some] = field.canonical.may_hold(found).float()
    live = _live_cells(alive.view(side, side, side))
    stretch = _TORN_STRETCH * float((high - low).norm()) / (side - 1)
    torn = _torn_cells(some, found, side, stretch)
    return PosedGrid(low, high, (side, side, side), live, rows, torn & live, transforms, volume)


def _reached(
    support: Support, joint: int, transform: Float[Tensor, "3 4"], axes: list[Tensor]
) -> tuple[slice, slice, slice] | None:
    """The block of the grid (z, y, x) that the joint's canonical box can fall on."""
    low, high = support.bone_low[joint], support.bone_high[joint]
    if bool((low > high).any()):
        return None
    half, middle = 0.5 * (high - low), 0.5 * (high + low)
    centre = transform[:, :3] @ middle + transform[:, 3]
    reach = transform[:, :3].abs() @ half
    spans = []
    for axis in (2, 1, 0):
        ticks = axes[axis]
        start = int(torch.searchsorted(ticks, centre[axis] - reach[axis]))
        stop = int(torch.searchsorted(ticks, centre[axis] + reach[axis], right=True))
        if stop <= start:
            return None
        spans.append(slice(start, stop))
    return spans[0], spans[1], spans[2]


def _live_cells(alive: Float[Tensor, "D H W"]) -> Bool[Tensor, "G"]:
    """Cells with any corner alive, at the index of their low corner."""
    padded = torch.nn.functional.pad(alive[None, None], (0, 1) * 3)
    return (torch.nn.functional.max_pool3d(padded, 2, stride=1) > 0.0).view(-1)


def _torn_cells(
    some: Int[Tensor, "P"], found: Float[Tensor, "P 3"], side: int, stretch_m: float
) -> Bool[Tensor, "G"]:
    """Cells whose corners' canonical points `found` (at grid points `some`) span too much."""
    reach = torch.full((6, side**3), -1e3, device=found.device)
    reach[:, some] = torch.cat([found, -found], dim=1).T
    padded = torch.nn.functional.pad(reach.view(1, 6, side, side, side), (0, 1) * 3, value=-1e3)
    most = torch.nn.functional.max_pool3d(padded, 2, stride=1).view(6, -1)
    return (most[:3] + most[3:]).amax(dim=0) > stretch_m


def direct_canonical(
    points: Float[Tensor, "N 3"], transforms: Float[Tensor, "K 3 4"], volume: WeightVolume,
    rounds: int, support: Support | None = None,
) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:  # fmt: skip
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
