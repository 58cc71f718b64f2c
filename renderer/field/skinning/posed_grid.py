"""One pose's canonical points on a grid over the posed body's box, made once a frame.

Where an arm hangs beside a thigh, a place in space comes from two places of the canonical body: the
skin of the one and the air round the other. Searches start from two joints' answers (one a joint in
SNARF, Chen et al. 2021); of what they find the place deeper in the body counts, as where solid
bodies unite.
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

_APART_M = 0.06
"""Answers of two joints so far from each other are two places of the body."""
_LEAST_SAY = 0.05
"""Weight of a joint whose answer is searched from besides the first's."""
_FOUND_M = 0.01
"""How near a found place must come, skinned forwards, to where it was searched for."""
_TORN_ROUNDS = 2
_TORN_STRETCH = 1.5
"""A cell is torn when its corners' canonical points span this many of its own diagonals."""


@dataclass(frozen=True, eq=False)
class _Body:
    """The body in one pose."""

    transforms: Float[Tensor, "K 3 4"]
    volume: WeightVolume
    support: Support

    def searched(
        self, points: Float[Tensor, "N 3"], start: Float[Tensor, "N 3"], rounds: int
    ) -> Float[Tensor, "N 3"]:
        """The canonical points of world `points`, by fixed-point rounds from `start`."""
        found = start
        for _ in range(rounds):
            found = blended_inverse(points, self.transforms, self.volume.at(found))
        return found

    def deeper(
        self, points: Float[Tensor, "N 3"], one: Float[Tensor, "N 3"],
        other: Float[Tensor, "N 3"], rounds: int,
    ) -> Float[Tensor, "N 3"]:  # fmt: skip
        """Of the places that searches from `one` and `other` find, the deeper in the body."""
        found = [self.searched(points, start, rounds) for start in (one, other)]
        depth = [
            torch.where(self.is_there(points, place), self.support.depths.at(place), -torch.inf)
            for place in found
        ]
        return torch.where((depth[1] > depth[0])[:, None], found[1], found[0])

    def united(
        self, points: Float[Tensor, "N 3"], first: Float[Tensor, "N 4"],
        second: Float[Tensor, "N 4"], rounds: int,
    ) -> Float[Tensor, "N 3"]:  # fmt: skip
        """What searches from the first answers find, or from the second, where those have a say."""
        found = self.searched(points, first[:, :3], rounds)
        two = torch.nonzero(second[:, 3] > _LEAST_SAY)[:, 0]
        found[two] = self.deeper(points[two], found[two], second[two, :3], rounds)
        return found

    def is_there(
        self, points: Float[Tensor, "N 3"], found: Float[Tensor, "N 3"]
    ) -> Bool[Tensor, "N"]:
        """Whether canonical `found`, skinned forwards, comes back to world `points`. Outside a bent
        hip is air that no place of the body moves to: searches there end anywhere."""
        back = blended(found, self.transforms, self.volume.at(found))
        return (back - points).square().sum(dim=1) < _FOUND_M**2


@dataclass(frozen=True, eq=False)
class PosedGrid(OccupancyGrid):
    """Canonical point and likelihood over the posed body's box; grid points span corner to
    corner."""

    rows: Float[Tensor, "G 4"]
    """Canonical point times likelihood, then likelihood: so that places without a canonical point
    do not pull their neighbours when rows are interpolated."""
    torn: Bool[Tensor, "G"]
    """Whether that cell's corners belong to places far apart in the canonical body, as between an
    arm and the side it rests on: nothing in between means anything there."""
    body: _Body

    def canonical(
        self, points: Float[Tensor, "N 3"]
    ) -> tuple[Float[Tensor, "N 3"], Float[Tensor, "N"]]:
        """Canonical points and likelihoods, interpolated; in torn cells, searched for anew."""
        index, weights = corners(self.cell_coordinates(points), self.shape)
        rows = weighted_rows(self.rows, index, weights)
        likelihood = rows[:, 3]
        found = rows[:, :3] / likelihood.clamp(min=1e-6)[:, None]
        torn = torch.nonzero(self.torn[index[:, 0]])[:, 0]
        if len(torn):
            found[torn] = self._searched(points[torn], index[torn], weights[torn])
        return found, likelihood

    def _searched(self, points: Tensor, index: Tensor, weights: Tensor) -> Float[Tensor, "N 3"]:
        """From the canonical point of the nearest corner that has one and from that of the corner
        farthest from it in the body."""
        near = self.rows[index]
        known = near[..., 3] > LEAST_LIKELIHOOD
        places = near[..., :3] / near[..., 3:].clamp(min=1e-6)
        every = torch.arange(len(near), device=near.device)
        one = places[every, (weights * known).argmax(dim=1)]
        apart = ((places - one[:, None]).norm(dim=2) * known).argmax(dim=1)
        return self.body.deeper(points, one, places[every, apart], _TORN_ROUNDS)


class _Answers:
    """For each grid point the answer of the joint with the most weight there, and of the one with
    the most among those whose answer lies elsewhere: canonical point, weight."""

    def __init__(self, side: int, device: torch.device) -> None:
        self.total = torch.zeros(side, side, side, device=device)
        self.sum = torch.zeros(side, side, side, 3, device=device)
        self.first = torch.zeros(side, side, side, 4, device=device)
        self.second = torch.zeros(side, side, side, 4, device=device)

    def hear(self, window: tuple[slice, slice, slice], answer: Float[Tensor, "d h w 4"]) -> None:
        """One joint's answers in a block of the grid."""
        first, second = self.first[window], self.second[window]
        apart = (answer[..., :3] - first[..., :3]).square().sum(-1) > _APART_M**2
        more = answer[..., 3] > first[..., 3]
        next_most = ~more & apart & (answer[..., 3] > second[..., 3])
        second = torch.where(next_most[..., None], answer, second)
        self.second[window] = torch.where((more & apart)[..., None], first, second)
        self.first[window] = torch.where(more[..., None], answer, first)
        self.total[window] += answer[..., 3]
        self.sum[window] += answer[..., 3:] * answer[..., :3]


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
    answers = _answers(volume, support, transforms, axes)
    likelihood = answers.total.view(-1).clamp(max=1.0)
    some = torch.nonzero(likelihood > LEAST_LIKELIHOOD)[:, 0]
    z, y, x = some // (side * side), some // side % side, some % side
    world = torch.stack([axes[0][x], axes[1][y], axes[2][z]], dim=1)
    body = _Body(transforms, volume, support)
    rounds = field.sizes.inverse_rounds
    if rounds:
        first, second = answers.first.view(-1, 4)[some], answers.second.view(-1, 4)[some]
        found = body.united(world, first, second, rounds)
        there = body.is_there(world, found)
        some, found = some[there], found[there]
    else:  # the paper's way: the mean of all answers, as it is
        found = answers.sum.view(-1, 3)[some] / answers.total.view(-1, 1)[some]
    rows = torch.zeros(side**3, 4, device=device)
    rows[some] = torch.cat([found, torch.ones_like(found[:, :1])], dim=1) * likelihood[some, None]
    alive = torch.zeros(side**3, device=device)
    alive[some] = field.canonical.may_hold(found).float()
    live = live_cells(alive.view(side, side, side))
    stretch = _TORN_STRETCH * float((high - low).norm()) / (side - 1)
    torn = _torn_cells(some, found, side, stretch)
    return PosedGrid(low, high, (side, side, side), live, rows, torn & live, body)


def _answers(
    volume: WeightVolume, support: Support, transforms: Float[Tensor, "K 3 4"], axes: list[Tensor]
) -> _Answers:
    """Every joint's answer where it has a say."""
    answers = _Answers(len(axes[0]), axes[0].device)
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
        answer = torch.zeros(len(points), 4, device=points.device)
        answer[inside] = torch.cat([near, volume.of_joint(joint, near)[:, None]], dim=1)
        answers.hear(window, answer.view(*x.shape, 4))
    return answers


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


def _torn_cells(
    some: Int[Tensor, "P"], found: Float[Tensor, "P 3"], side: int, stretch_m: float
) -> Bool[Tensor, "G"]:
    """Cells whose corners' canonical points `found` (at grid points `some`) span too much."""
    reach = torch.full((6, side**3), -1e3, device=found.device)
    reach[:, some] = torch.cat([found, -found], dim=1).T
    padded = torch.nn.functional.pad(reach.view(1, 6, side, side, side), (0, 1) * 3, value=-1e3)
    most = torch.nn.functional.max_pool3d(padded, 2, stride=1).view(6, -1)
    return (most[:3] + most[3:]).amax(dim=0) > stretch_m
