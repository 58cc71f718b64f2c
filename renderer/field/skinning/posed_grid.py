"""Canonical points of one pose on a grid over the posed body's box, computed once a frame.

Where an arm hangs beside a thigh, a point in space has two canonical correspondences: the skin of
the one and the air around the other. Searches start from two joints' candidates (one a joint in
SNARF, Chen et al. 2021); of their results the point deeper in the body is taken, as in the union of
solids.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from renderer.field.field import PersonField
from renderer.field.networks.grid_interpolation import corners, weighted_rows
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.skinning.inverse_skinning import WeightVolume, blended, blended_inverse
from renderer.field.skinning.posed_body import LEAST_LIKELIHOOD, Support, live_cells
from scene.arrays import Bool, Float, Int, Tensor

_DISTINCT_M = 0.06
"""Candidates of two joints so far from each other are distinct correspondences."""
_MIN_WEIGHT = 0.05
"""Weight from which the second candidate is searched from too."""
_CONVERGED_M = 0.01
"""Largest residual, after forward skinning, of a converged search."""
_DISCONTINUOUS_ROUNDS = 2
_DISCONTINUOUS_STRETCH = 1.5
"""A cell is discontinuous where its corners' canonical points span so many of its diagonals."""


@dataclass(frozen=True, eq=False)
class _PosedBody:
    """The body in one pose."""

    transforms: Float[Tensor, "K 3 4"]
    volume: WeightVolume
    support: Support

    def search(
        self, points: Float[Tensor, "N 3"], start: Float[Tensor, "N 3"], rounds: int
    ) -> Float[Tensor, "N 3"]:
        """The canonical points of world `points`, by fixed-point rounds from `start`."""
        found = start
        for _ in range(rounds):
            found = blended_inverse(points, self.transforms, self.volume.at(found))
        return found

    def search_deeper(
        self,
        points: Float[Tensor, "N 3"],
        one: Float[Tensor, "N 3"],
        other: Float[Tensor, "N 3"],
        rounds: int,
    ) -> Float[Tensor, "N 3"]:
        """Of the results of searches from `one` and `other`, the deeper in the body."""
        found = [self.search(points, start, rounds) for start in (one, other)]
        depth = [
            torch.where(self.converged(points, place), self.support.depths.at(place), -torch.inf)
            for place in found
        ]
        return torch.where((depth[1] > depth[0])[:, None], found[1], found[0])

    def search_candidates(
        self,
        points: Float[Tensor, "N 3"],
        first: Float[Tensor, "N 4"],
        second: Float[Tensor, "N 4"],
        rounds: int,
    ) -> Float[Tensor, "N 3"]:
        """Results of searches from the first candidates, and from the second where these have
        weight."""
        found = self.search(points, first[:, :3], rounds)
        ambiguous = torch.nonzero(second[:, 3] > _MIN_WEIGHT)[:, 0]
        found[ambiguous] = self.search_deeper(
            points[ambiguous], found[ambiguous], second[ambiguous, :3], rounds
        )
        return found

    def converged(
        self, points: Float[Tensor, "N 3"], found: Float[Tensor, "N 3"]
    ) -> Bool[Tensor, "N"]:
        """Whether canonical `found`, skinned forwards, gives world `points`. Air outside a bent hip
        has no correspondence: searches there do not converge."""
        skinned = blended(found, self.transforms, self.volume.at(found))
        return (skinned - points).square().sum(dim=1) < _CONVERGED_M**2


@dataclass(frozen=True, eq=False)
class PosedGrid(OccupancyGrid):
    """Canonical point and likelihood over the posed body's box; grid points span corner to
    corner."""

    rows: Float[Tensor, "G 4"]
    """Canonical point times likelihood, then likelihood: so that points without a correspondence
    do not distort interpolation."""
    discontinuous: Bool[Tensor, "G"]
    """Whether the cell's corners are far apart in the canonical body, as between an arm and the
    side it rests on: interpolation is meaningless there."""
    body: _PosedBody

    def canonical(
        self, points: Float[Tensor, "N 3"]
    ) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
        """Canonical points and likelihoods, interpolated; searched in discontinuous cells."""
        index, weights = corners(self.cell_coordinates(points), self.shape)
        rows = weighted_rows(self.rows, index, weights)
        likelihood = rows[:, 3]
        found = rows[:, :3] / likelihood.clamp(min=1e-6)[:, None]
        discontinuous = torch.nonzero(self.discontinuous[index[:, 0]])[:, 0]
        if len(discontinuous):
            found[discontinuous] = self._search_from_corners(
                points[discontinuous], index[discontinuous], weights[discontinuous]
            )
        return found, likelihood

    def _search_from_corners(
        self, points: Tensor, index: Tensor, weights: Tensor
    ) -> Float[Tensor, "N 3"]:
        """Searches from the canonical point of the nearest valid corner and from the corner
        farthest from that in the body."""
        corner_rows = self.rows[index]
        known = corner_rows[..., 3] > LEAST_LIKELIHOOD
        places = corner_rows[..., :3] / corner_rows[..., 3:].clamp(min=1e-6)
        rows_index = torch.arange(len(corner_rows), device=corner_rows.device)
        nearest = places[rows_index, (weights * known).argmax(dim=1)]
        farthest = ((places - nearest[:, None]).norm(dim=2) * known).argmax(dim=1)
        return self.body.search_deeper(
            points, nearest, places[rows_index, farthest], _DISCONTINUOUS_ROUNDS
        )


class _Candidates:
    """For each grid point the candidate of the joint with the largest weight, and the one with the
    largest weight among distinct ones: canonical point, weight."""

    def __init__(self, side: int, device: torch.device) -> None:
        self.total = torch.zeros(side, side, side, device=device)
        self.sum = torch.zeros(side, side, side, 3, device=device)
        self.first = torch.zeros(side, side, side, 4, device=device)
        self.second = torch.zeros(side, side, side, 4, device=device)

    def add(self, window: tuple[slice, slice, slice], candidate: Float[Tensor, "d h w 4"]) -> None:
        """Add one joint's candidates in a block of the grid."""
        first, second = self.first[window], self.second[window]
        distinct = (candidate[..., :3] - first[..., :3]).square().sum(-1) > _DISTINCT_M**2
        better = candidate[..., 3] > first[..., 3]
        second_best = ~better & distinct & (candidate[..., 3] > second[..., 3])
        second = torch.where(second_best[..., None], candidate, second)
        self.second[window] = torch.where((better & distinct)[..., None], first, second)
        self.first[window] = torch.where(better[..., None], candidate, first)
        self.total[window] += candidate[..., 3]
        self.sum[window] += candidate[..., 3:] * candidate[..., :3]


@torch.no_grad()
def posed_grid(
    field: PersonField,
    volume: WeightVolume,
    support: Support,
    transforms: Float[Tensor, "K 3 4"],
) -> PosedGrid:
    """The grid of one pose. Each joint is evaluated only on the part of the grid it can reach."""
    side = field.sizes.posed_grid
    low, high = support.bounds(transforms)
    device = low.device
    axes = [torch.linspace(float(low[a]), float(high[a]), side, device=device) for a in range(3)]
    candidates = _joint_candidates(volume, support, transforms, axes)
    likelihood = candidates.total.view(-1).clamp(max=1.0)
    occupied = torch.nonzero(likelihood > LEAST_LIKELIHOOD)[:, 0]
    z, y, x = occupied // (side * side), occupied // side % side, occupied % side
    world = torch.stack([axes[0][x], axes[1][y], axes[2][z]], dim=1)
    body = _PosedBody(transforms, volume, support)
    rounds = field.sizes.inverse_rounds
    if rounds:
        first, second = (
            candidates.first.view(-1, 4)[occupied],
            candidates.second.view(-1, 4)[occupied],
        )
        found = body.search_candidates(world, first, second, rounds)
        consistent = body.converged(world, found)
        occupied, found = occupied[consistent], found[consistent]
    else:  # as published: the weighted mean of all candidates
        found = candidates.sum.view(-1, 3)[occupied] / candidates.total.view(-1, 1)[occupied]
    rows = torch.zeros(side**3, 4, device=device)
    rows[occupied] = (
        torch.cat([found, torch.ones_like(found[:, :1])], dim=1) * likelihood[occupied, None]
    )
    alive = torch.zeros(side**3, device=device)
    alive[occupied] = field.canonical.may_hold(found).float()
    live = live_cells(alive.view(side, side, side))
    stretch = _DISCONTINUOUS_STRETCH * float((high - low).norm()) / (side - 1)
    discontinuous = _discontinuous_cells(occupied, found, side, stretch)
    return PosedGrid(low, high, (side, side, side), live, rows, discontinuous & live, body)


def _joint_candidates(
    volume: WeightVolume, support: Support, transforms: Float[Tensor, "K 3 4"], axes: list[Tensor]
) -> _Candidates:
    """Every joint's candidates where it has weight."""
    candidates = _Candidates(len(axes[0]), axes[0].device)
    for joint in range(len(transforms)):
        window = _joint_window(support, joint, transforms[joint], axes)
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
        candidate = torch.zeros(len(points), 4, device=points.device)
        candidate[inside] = torch.cat([near, volume.of_joint(joint, near)[:, None]], dim=1)
        candidates.add(window, candidate.view(*x.shape, 4))
    return candidates


def _joint_window(
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


def _discontinuous_cells(
    occupied: Int[Tensor, "P"], found: Float[Tensor, "P 3"], side: int, stretch_m: float
) -> Bool[Tensor, "G"]:
    """Cells whose corners' canonical points `found` (at grid points `some`) span too much."""
    reach = torch.full((6, side**3), -1e3, device=found.device)
    reach[:, occupied] = torch.cat([found, -found], dim=1).T
    padded = torch.nn.functional.pad(reach.view(1, 6, side, side, side), (0, 1) * 3, value=-1e3)
    most = torch.nn.functional.max_pool3d(padded, 2, stride=1).view(6, -1)
    return (most[:3] + most[3:]).amax(dim=0) > stretch_m
