"""Expressions of a person of splats: which splats they move, and how far.

A splat's rest position in a frame is its own plus the sum over blend shapes of the weight
(`scene.expression`) times the splat's offset, before skinning. Offsets are those of the body's
surface where the splat began. Learning them too, by an Adam like that of positions, was measured
and left out: on a studio face in poses never seen it loses 0.3 dB at a tenth of the positions' rate
and 1.7 dB at half of it, and those of the very performer are no better than the body model's.
"""

from __future__ import annotations

from collections.abc import Sequence as Many
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from renderer.splats.cloth.hanging import BoundSplats
from renderer.splats.layout import POSITION
from renderer.splats.skinned import SkinnedSplats
from scene.arrays import Array, Float, Int
from scene.expression import BLEND_SHAPE_COUNT, CURLS, blend_shape_weights, by_curls

_LEAST_M = 1e-4
"""Splats that no expression moves further are left out."""


def no_splats() -> Int[Array, "0"]:
    """Of a model without blend shapes."""
    return np.zeros(0, np.int32)


def no_offsets() -> Float[Array, "0 S 3"]:
    """Of a model without blend shapes."""
    return np.zeros((0, BLEND_SHAPE_COUNT, 3), np.float32)


def moving_splats(
    offsets: Float[Array, "N S 3"],
) -> tuple[Int[Array, "M"], Float[Array, "M S 3"]]:
    """The splats that `offsets` (m) move at all, and how far."""
    splats = np.flatnonzero((np.linalg.norm(offsets, axis=2) > _LEAST_M).any(axis=1))
    return splats.astype(np.int32), offsets[splats].astype(np.float32)


def moving_rows(
    splats: Int[Array, "M"], rows: Int[Array, "G"], count: int
) -> tuple[Int[Array, "K"], Int[Array, "K"]]:
    """Of `count` splats, those of `rows` are taken, each as often as it is named: which of them
    are among `splats`, which expressions move, and the place of each in these."""
    places = np.full(count, -1)
    places[splats] = np.arange(len(splats))
    places = places[rows]
    moving = np.flatnonzero(places >= 0)
    return moving.astype(np.int32), places[moving]


class BlendShapes:
    """Expression blend shapes of a set of models, applied in place without allocating."""

    def __init__(self, models: Many[SkinnedSplats]) -> None:
        starts = np.cumsum([0] + [len(model.parameters) for model in models])
        counts = [len(model.expression_splats) for model in models]
        place = slice(POSITION, POSITION + 3)
        self.splats = np.concatenate(
            [m.expression_splats.astype(np.int32) + s for m, s in zip(models, starts, strict=False)]
        ).astype(np.int32)
        self.owner = np.repeat(np.arange(len(models)), counts).astype(np.int32)
        self.rest = np.concatenate(
            [m.parameters[m.expression_splats.astype(np.int64), place] for m in models]
        ).astype(np.float32)
        self.offsets = np.concatenate([m.expression_offsets for m in models]).astype(np.float32)
        self.shown = np.zeros((len(models), BLEND_SHAPE_COUNT), np.float32)

    @property
    def any(self) -> bool:
        """Whether any model has blend shapes."""
        return len(self.splats) > 0

    def show(self, expressions: Many[Float[Array, "E"]] | None) -> None:
        """Set each model's expression; None: all are at rest."""
        if expressions is None:
            self.shown[:] = 0.0
            return
        for row, expression in zip(self.shown, expressions, strict=True):
            row[:] = blend_shape_weights(expression)

    def move(self, parameters: Float[Array, "N P"]) -> None:
        """Write the blended rest positions into `parameters`."""
        from renderer.splats.expression_kernels import apply_blend_shapes

        apply_blend_shapes(parameters, self.splats, self.owner, self.rest, self.offsets, self.shown)


@dataclass(frozen=True, eq=False)
class ClipBlendShapes:
    """What moves splats of one model at rest in each frame of a clip: expressions and cloth."""

    splats: Int[Array, "M"]
    offsets: Float[Array, "M S 3"]
    expressions: Float[Array, "F E"]
    bound: BoundSplats | None = None
    """Splats on loose clothes, which move as well."""
    hung: Float[Array, "F V 3"] | None = None
    """How these hang in each frame."""

    def moved(self, parameters: Float[Array, "N P"], frame: int) -> Float[Array, "N P"]:
        """`parameters` at rest as frame `frame` shows them: a copy where anything moves.

        The gradient by a position that an expression has moved is that by the position; see
        `take_back` of those on cloth.
        """
        moved = self._shown(parameters, frame)
        if self.bound is not None and self.hung is not None:
            moved = parameters.copy() if moved is parameters else moved
            own = parameters[self.bound.rows]
            self.bound.hang(moved, own, self.hung[frame])
        return moved

    def take_back(self, gradient: Float[Array, "N P"], frame: int) -> None:
        """Turn a gradient by what `moved` returns into one by the parameters, in place."""
        if self.bound is not None and self.hung is not None:
            self.bound.take_back(gradient, self.hung[frame])

    def by_curls(self, gradient: Float[Array, "N P"], frame: int) -> Float[Array, "C"]:
        """Turn a gradient by what `moved` returns into one by the curls of the frame's fingers."""
        fingers, offsets = self._fingers
        by_weights = offsets @ gradient[fingers, POSITION : POSITION + 3].reshape(-1)
        return by_curls(by_weights, self.expressions[frame])

    @cached_property
    def _fingers(self) -> tuple[Int[Array, "K"], Float[Array, "S J"]]:
        """The splats of fingers, and how far they move, the axes of each after another."""
        bends = self.offsets.copy()
        bends[:, : CURLS.start] = 0.0
        moving = np.flatnonzero((np.linalg.norm(bends, axis=2) > _LEAST_M).any(axis=1))
        # as rows: times a vector, columns take ten times as long
        offsets = bends[moving].transpose(1, 0, 2).reshape(bends.shape[1], -1)
        return self.splats[moving], offsets

    def _shown(self, parameters: Float[Array, "N P"], frame: int) -> Float[Array, "N P"]:
        if not len(self.splats) or not self.expressions[frame].any():
            return parameters
        from renderer.splats.expression_kernels import apply_blend_shapes

        moved = parameters.copy()
        rest = parameters[self.splats, POSITION : POSITION + 3]
        shown = blend_shape_weights(self.expressions[frame : frame + 1]).astype(np.float32)
        owner = np.zeros(len(self.splats), np.int32)
        apply_blend_shapes(moved, self.splats, owner, rest, self.offsets, shown)
        return moved
