"""Merges splats that look alike: plain cloth needs few, a print or a face many.

Neighbours at rest join in pairs, the cheapest first, as in Ward's clustering (1963): what a pair
costs is about the squared error that its one colour leaves in pictures, from all round and in the
frames. As nothing is taken away, no side gets holes, whoever looks.

Letters: N splats, G groups of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from renderer.splats.expressions import moving_splats
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from renderer.splats.training.initialisation import FirstSplats
from scene.arrays import Array, Float, Int
from scene.rotations import matrix_to_quaternion, quaternion_to_matrix
from scene.skeleton import JOINT_COUNT

_NEAR = 8
"""Neighbours among which a splat finds its partner."""
_SHARE_A_ROUND = 0.5
"""Of the pairs found, the cheapest that join before all look again."""
_NORMAL, _PLACE_M = 0.15, 2.0
"""Difference of a colour that counts as much as one of normals by 1; metres that do."""
_EVENLY_NEAR, _EVENLY_PLACE_M = 4, 0.25
"""The same of `joins`: a small picture shows where splats end rather than a print. With those
above, half of the splats at half the size lose 0.4 dB of what they gain."""
_WIDENED = 0.6
"""How far a merged splat is widened, of what would make it as bright as its splats, in logarithms:
some of their light lay on one another. With all of it the outline swells, with none cloth has
gaps: 42.6 and 40.9 dB to the picture before half of 10,000 are merged, 47.8 between."""
_COLOURS, _PLACE = slice(COLOUR, COLOUR + 3), slice(POSITION, POSITION + 3)
_SCALES, _TURN = slice(LOG_SCALE, LOG_SCALE + 3), slice(ROTATION, ROTATION + 4)


@dataclass(frozen=True, eq=False)
class Grouping:
    """Which splats become one."""

    group: Int[Array, "N"]
    """From 0 to G - 1."""
    light: Float[Array, "N"]
    """What each counts for in its group: the light that it blends into pictures, px, above 0."""

    def __len__(self) -> int:
        return int(self.group.max()) + 1

    def mean(self, values: Float[Array, "N *X"]) -> Float[Array, "G *X"]:
        """Of each group, by light."""
        share = self.light / np.bincount(self.group, self.light)[self.group]
        columns = [
            np.bincount(self.group, share * column) for column in values.reshape(len(values), -1).T
        ]
        return np.stack(columns, axis=1).reshape(len(self), *values.shape[1:])

    def turns(self, parameters: Float[Array, "N P"]) -> Float[Array, "G 4"]:
        """Quaternions (w, x, y, z) of the axes along which each group spreads."""
        _, axes = np.linalg.eigh(self._covariance(parameters.astype(np.float64)))
        axes[np.linalg.det(axes) < 0.0] *= -1.0
        return matrix_to_quaternion(axes)

    def merged(
        self,
        parameters: Float[Array, "N P"],
        turns: Float[Array, "G 4"],
        widened: float = _WIDENED,
    ) -> Float[Array, "G P"]:
        """One splat a group: mean place, colour and opacity, along the axes `turns` spread as far
        as all of them, and as bright, by the share `widened`; whoever is alone stays as they are.
        """
        p, brightest = parameters.astype(np.float64), self._brightest
        merged, axes = p[brightest], quaternion_to_matrix(turns)
        along = np.einsum("gji,gjk,gki->gi", axes, self._covariance(p), axes)
        opacity = 1.0 / (1.0 + np.exp(-p[:, OPACITY]))
        of_all = self.mean(opacity)
        light = np.bincount(self.group, self.light) / self.light[brightest]
        bright = light * opacity[brightest] * _area(p[brightest, _SCALES]) / of_all
        logs = 0.5 * np.log(along)
        wider = widened * 0.5 * np.log(np.maximum(bright / _area(logs), 1.0))
        merged[:, _SCALES] = logs + np.where(logs > logs.min(axis=1)[:, None], wider[:, None], 0.0)
        merged[:, _PLACE], merged[:, _COLOURS] = self.mean(p[:, _PLACE]), self.mean(p[:, _COLOURS])
        merged[:, _TURN], merged[:, OPACITY] = turns, np.log(of_all / (1.0 - of_all))
        alone = np.bincount(self.group) == 1
        merged[alone] = p[brightest[alone]]
        return merged.astype(np.float32)

    def _covariance(self, p: Float[Array, "N P"]) -> Float[Array, "G 3 3"]:
        off, turn = p[:, _PLACE] - self.mean(p[:, _PLACE])[self.group], p[:, _TURN]
        axes = quaternion_to_matrix(turn)
        own = np.einsum("nij,nj,nkj->nik", axes, np.exp(2.0 * p[:, _SCALES]), axes)
        return self.mean(own + off[:, :, None] * off[:, None, :])

    def merged_first(self, first: FirstSplats, widened: float = _WIDENED) -> FirstSplats:
        """The same of splats before training, with all that they have beside parameters."""
        count = len(first.parameters)
        weights = np.zeros((count, JOINT_COUNT))
        np.add.at(weights, (np.arange(count)[:, None], first.joints), first.weights)
        weights = self.mean(weights)
        strongest = np.argsort(-weights, axis=1)[:, :4]
        top = np.take_along_axis(weights, strongest, axis=1)
        offsets = np.zeros((count, *first.expression_offsets.shape[1:]), np.float32)
        offsets[first.expression_splats] = first.expression_offsets
        moving, offsets = moving_splats(self.mean(offsets))
        return FirstSplats(
            self.merged(first.parameters, self.turns(first.parameters), widened),
            strongest.astype(np.uint16),
            (top / top.sum(axis=1, keepdims=True)).astype(np.float32),
            unit(self.mean(first.normals)),
            moving,
            offsets,
            first.quads[self._brightest],
        )

    @cached_property
    def _brightest(self) -> Int[Array, "G"]:
        order = np.lexsort((self.light, self.group))
        return order[np.append(np.flatnonzero(np.diff(self.group[order])), len(order) - 1)]


def unit(normals: Float[Array, "G 3"]) -> Float[Array, "G 3"]:
    """As long as 1."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.maximum(length, 1e-9)).astype(np.float32)


def groupings(
    parameters: Float[Array, "N P"],
    normals: Float[Array, "N 3"],
    kinds: Int[Array, "N"],
    light: Float[Array, "N"],
    counts: list[int],
    widest_m: float,
) -> Iterator[Grouping]:
    """For each of `counts`, falling, a grouping of so many groups, until no more can join.

    Args:
        kinds: only splats of the same one join.
        light: px, above 0.
        widest_m: most deviation of a splat that has others in it.
    """
    clusters = _Clusters(parameters, normals, kinds, light, widest_m, _NEAR, _PLACE_M)
    for count in counts:
        while len(clusters) > count and clusters.join(len(clusters) - count):
            pass
        yield Grouping(clusters.group, light)
        if len(clusters) > count:
            return


def joins(
    parameters: Float[Array, "N P"],
    normals: Float[Array, "N 3"],
    kinds: Int[Array, "N"],
    light: Float[Array, "N"],
    count: int,
) -> Int[Array, "J 2"]:
    """Pairs in the order in which they join until `count` are left, or no more can.

    The first pair becomes number N, the next one N + 1; these are joined further by their numbers.
    Other arguments as of `groupings`.
    """
    clusters = _Clusters(parameters, normals, kinds, light, np.inf, _EVENLY_NEAR, _EVENLY_PLACE_M)
    while len(clusters) > count:
        if not clusters.join(len(clusters) - count) and not clusters.look_further():
            break
    return np.concatenate([np.zeros((0, 2), np.int64), *clusters.joined])


class _Clusters:
    """Groups as they grow."""

    def __init__(
        self,
        parameters: Float[Array, "N P"],
        normals: Float[Array, "N 3"],
        kinds: Int[Array, "N"],
        light: Float[Array, "N"],
        widest_m: float,
        near: int,
        place_m: float,
    ) -> None:
        colours, places = parameters[:, _COLOURS], parameters[:, _PLACE].astype(np.float64)
        self.group, self._kinds, self._light = np.arange(len(light)), kinds, light.copy()
        self._alike = np.column_stack([colours, _NORMAL * normals, places / place_m])
        self._place, self._area, self._most = places, _area(parameters[:, _SCALES]), widest_m**2
        self._near = near
        self._number, self._next = np.arange(len(light)), len(light)
        self.joined: list[Int[Array, "_ 2"]] = []
        """Pairs by their numbers, a round after the other."""

    def __len__(self) -> int:
        return len(self._light)

    def look_further(self) -> bool:
        """Find partners among twice as many neighbours: kinds lie among one another at joints, and
        where hair hangs before a chest. Whether there are more."""
        more = self._near < len(self) - 1
        self._near *= 2
        return more

    def join(self, most: int) -> bool:
        """Join the cheapest pairs, at most `most`; whether there were any."""
        first, second = self._pairs(most)
        if not len(first):
            return False
        self.joined.append(np.column_stack([self._number[first], self._number[second]]))
        self._number[first] = self._next + np.arange(len(first))
        self._next += len(first)
        kept = np.ones(len(self), bool)
        kept[second] = False
        row = np.cumsum(kept) - 1
        row[second] = row[first]
        share = (self._light[second] / (self._light[first] + self._light[second]))[:, None]
        for values in (self._alike, self._place):
            values[first] += share * (values[second] - values[first])
        self._light[first] += self._light[second]
        self._area[first] += self._area[second]
        self.group = row[self.group]
        self._alike, self._place = self._alike[kept], self._place[kept]
        self._light, self._area = self._light[kept], self._area[kept]
        self._kinds, self._number = self._kinds[kept], self._number[kept]
        return True

    def _pairs(self, most: int) -> tuple[Int[Array, "M"], Int[Array, "M"]]:
        """Of clusters that are each other's cheapest partner, the cheaper half."""
        from scipy.spatial import KDTree

        near_count = min(self._near + 1, len(self))
        _, near = KDTree(self._place).query(self._place, k=near_count)
        near, own = np.asarray(near)[:, 1:], np.arange(len(self))[:, None]
        light = self._light[near] * self._light[own] / (self._light[near] + self._light[own])
        cost = light * np.square(self._alike[near] - self._alike[own]).sum(axis=2)
        wide = self._area[near] + self._area[own] > self._most
        cost[wide | (self._kinds[near] != self._kinds[own])] = np.inf
        cheapest, rows = cost.argmin(axis=1), np.arange(len(self))
        partner, least = near[rows, cheapest], cost[rows, cheapest]
        mutual = (partner[partner] == rows) & (rows < partner) & np.isfinite(least)
        first = rows[mutual]
        order = first[np.argsort(least[first], kind="stable")]
        taken = order[: min(most, max(1, round(_SHARE_A_ROUND * len(order))))]
        return taken, partner[taken]


def _area(log_scales: Float[Array, "N 3"]) -> Float[Array, "N"]:
    """Product of the two larger deviations, m^2."""
    return np.exp(log_scales.sum(axis=1) - log_scales.min(axis=1)).astype(np.float64)
