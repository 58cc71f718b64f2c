"""A model's splats at any number from a thousand or so to all of them.

Splats that look alike join in pairs (`training.merging`), the least visible change first, until
`FEWEST` are left: those are the roots. Read backwards, each join is a *split* that puts two splats
in the place of one, so that every count between is a whole model, and the next count differs from
it in three splats alone. A renderer that goes from one level to another does so split by split.

Letters: N splats of the model, J splits, R = N - J roots, M = N + J nodes: roots first, then the
two of each split, in the order in which they come as detail rises.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary, WeakSet

import numpy as np

from renderer.relighting.shading import albedo_of, normals_of
from renderer.splats.cloth.hanging import NO_CLOTH
from renderer.splats.layout import POSITION
from renderer.splats.levels.light import light_all_round
from renderer.splats.model import SplatModel
from renderer.splats.training.initialisation import FirstSplats
from renderer.splats.training.merging import Grouping, joins
from renderer.splats.training.surface_kinds import strongest_joints, surface_kinds
from scene.arrays import Array, Bool, Float, Int
from scene.skeleton import JOINT_COUNT

FEWEST = 1500
"""Splats of the coarsest level: as many as the first 50 kB of a viewer's file hold."""
_LEAST_LIGHT_PX = 1e-3
_LOOKED_AT_MORE = 3.0
"""How much more the light of face and hands counts: they are looked at."""
_WIDENED = 0.4
"""As in `training.merging`, where nothing is trained after it: on studio performers at half the
size, half of the splats are 0.8 dB better than with 0.6."""


@dataclass(frozen=True, eq=False)
class LevelTree:
    """The levels of one model."""

    nodes: SplatModel
    """Every splat of every level, M of them; motion and skeleton are the model's."""
    split: Int[Array, "J"]
    """Which node each split replaces, by the nodes R + 2 j and R + 2 j + 1."""
    first_share: Float[Array, "J"]
    """Of the node's light, how much is in the first of the two."""
    rows: Int[Array, "N"]
    """Where each of the model's splats is among the nodes."""

    def __len__(self) -> int:
        """Splats of the finest level."""
        return len(self.rows)

    @property
    def fewest(self) -> int:
        """Splats of the coarsest level."""
        return len(self.rows) - len(self.split)

    @cached_property
    def until(self) -> Int[Array, "M"]:
        """Count from which each node is replaced by two others; past N for the model's own."""
        until = np.full(len(self.nodes), len(self) + 1, np.int32)
        until[self.split] = self.fewest + 1 + np.arange(len(self.split))
        return until

    def clamped(self, count: float) -> int:
        """The nearest number of splats that there is a level of."""
        return int(min(max(round(count), self.fewest), len(self)))

    def drawn(self, count: int) -> Bool[Array, "M"]:
        """Which nodes are the model of `count` splats, from `fewest` to N."""
        drawn = self.until > count
        drawn[2 * count - self.fewest :] = False
        return drawn

    def level(self, count: int) -> SplatModel:
        """The model of `count` splats by itself."""
        rows = self.drawn(count)
        nodes, place = self.nodes, np.cumsum(rows) - 1
        moving = rows[nodes.expression_splats]
        return replace(
            nodes,
            parameters=nodes.parameters[rows],
            joints=nodes.joints[rows],
            weights=nodes.weights[rows],
            seen=nodes.seen[rows],
            quads=nodes.quads[rows],
            albedo=albedo_of(nodes)[rows],
            normals=normals_of(nodes)[rows],
            expression_splats=place[nodes.expression_splats[moving]].astype(np.int32),
            expression_offsets=nodes.expression_offsets[moving],
        )

    def spread(self, values: Float[Array, "N C"]) -> Float[Array, "M C"]:
        """`values` of the model's splats; means by light for those that stand for several."""
        from renderer.splats.levels.level_kernels import average_upwards

        spread = np.empty((len(self.nodes), values.shape[1]), np.float32)
        spread[self.rows] = values
        average_upwards(spread, self.split, self.first_share, self.fewest)
        return spread


def level_tree(model: SplatModel) -> LevelTree:
    """The levels of `model`; worked out once, in about a second for 10,000 splats, and kept as long
    as the model lives."""
    if model not in _TREES:
        _TREES[model] = _grown(model)
    return _TREES[model]


def tree_soon(model: SplatModel) -> LevelTree | None:
    """The levels of `model`, where they are known; else they are worked out beside, from now on.

    None, too, for so few splats that there is but one level.
    """
    if (tree := _TREES.get(model)) is not None:
        return tree
    if len(model) > FEWEST and model not in _GROWING:
        _GROWING.add(model)
        _BESIDE.submit(level_tree, model)
    return None


_TREES: WeakKeyDictionary[SplatModel, LevelTree] = WeakKeyDictionary()
_GROWING: WeakSet[SplatModel] = WeakSet()
_BESIDE = ThreadPoolExecutor(max_workers=1, thread_name_prefix="levels")


def _grown(model: SplatModel) -> LevelTree:
    count = len(model)
    light = light_all_round(model).astype(np.float64) + _LEAST_LIGHT_PX
    light[model.expression_splats] *= _LOOKED_AT_MORE
    rest, normals = model.parameters[:, POSITION : POSITION + 3], normals_of(model)
    kinds = surface_kinds(rest, model.joints, model.weights, model.skeleton)
    # a joint's splats keep to themselves, so that what merges also moves together
    kinds = JOINT_COUNT * kinds + strongest_joints(model.joints, model.weights)
    kinds = 2 * kinds + (model.quads != NO_CLOTH)
    pairs = joins(model.parameters, normals, kinds, light, min(FEWEST, count))
    if not len(pairs):
        whole = replace(model, albedo=albedo_of(model), normals=normals)
        none = np.zeros(0)
        return LevelTree(whole, none.astype(np.int32), none.astype(np.float32), np.arange(count))
    of_node = np.append(light, np.zeros(len(pairs)))
    leaves = list(np.arange(count)[:, None])
    for number, (first, second) in enumerate(pairs, count):
        of_node[number] = of_node[first] + of_node[second]
        leaves.append(np.concatenate([leaves[first], leaves[second]]))
    joined = np.zeros(count + len(pairs), bool)
    joined[pairs] = True
    roots = np.flatnonzero(~joined)
    roots = roots[np.argsort(-of_node[roots], kind="stable")]
    order = np.concatenate([roots, pairs[::-1].ravel()])
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return LevelTree(
        _with_merged(model, leaves[count:], light, order),
        place[count + np.arange(len(pairs))[::-1]].astype(np.int32),
        (of_node[pairs[::-1, 0]] / of_node[count:][::-1]).astype(np.float32),
        place[:count],
    )


def _with_merged(
    model: SplatModel,
    merged: list[Int[Array, "_"]],
    light: Float[Array, "N"],
    order: Int[Array, "M"],
) -> SplatModel:
    """`model`, and splats in the place of each of `merged` rows of it, in this `order`."""
    known = FirstSplats(
        model.parameters,
        model.joints,
        model.weights,
        normals_of(model),
        model.expression_splats,
        model.expression_offsets,
        model.quads,
    )
    albedo = albedo_of(model)
    rows = np.concatenate(merged)
    grouping = Grouping(
        np.repeat(np.arange(len(merged)), [len(one) for one in merged]), light[rows]
    )
    few = grouping.merged_first(known.taken(rows), _WIDENED)
    start = len(model)
    splats = np.append(model.expression_splats, start + few.expression_splats)
    offsets = np.concatenate([model.expression_offsets, few.expression_offsets])
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    rising = np.argsort(place[splats])

    def all_of(own: Array, of_merged: Array) -> Array:
        return np.concatenate([own, of_merged]).astype(own.dtype)[order]

    return replace(
        model,
        parameters=all_of(model.parameters, few.parameters),
        joints=all_of(model.joints, few.joints),
        weights=all_of(model.weights, few.weights),
        seen=all_of(model.seen, grouping.mean(model.seen[rows].astype(np.float64)) > 0.5),
        albedo=all_of(albedo, grouping.mean(albedo[rows])),
        normals=all_of(known.normals, few.normals),
        quads=all_of(model.quads, few.quads),
        expression_splats=place[splats][rising].astype(np.int32),
        expression_offsets=offsets[rising],
    )
