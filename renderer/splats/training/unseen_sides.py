"""What is guessed of sides that no frame shows: their colours, and the hair that covers them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from renderer.splats.training.evidence import Evidence
from renderer.splats.training.filling import fill_unseen, held_colours
from renderer.splats.training.hair import Hair, hair_of_unseen_sides
from renderer.splats.training.neighbours import neighbours_at_rest
from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View
from scene.arrays import Array, Bool, Float, Int
from scene.skeleton import Skeleton

_CLOSED = [KINDS.index(kind) for kind in ("trunk", "arms", "legs")]
_FAR_ROUNDS = 4
"""Neighbours of neighbours, and so on, that show nothing either: next to a rim, splats that face
away stand out beyond the outline, and have to be trained."""


def far_sides(
    rest: Float[Array, "N 3"], found: Evidence, kinds: Int[Array, "N"]
) -> Bool[Array, "N"]:
    """Splats of trunk and limbs that lie far from all that frames show: what would move them is
    light that the front lets through, which makes holes in a back behind a print."""
    edges, near = neighbours_at_rest(rest), ~found.hidden
    for _ in range(_FAR_ROUNDS):
        near |= edges @ near > 0
    return ~near & np.isin(kinds, _CLOSED)


def guess_sides(
    splats: TrainedSplats,
    found: Evidence,
    frames: Iterable[tuple[View, Float[Array, "K 4 4"]]],
    skeleton: Skeleton,
) -> Hair:
    """Fill the colours of `splats` that no frame shows; returns the hair that is to cover some.

    Args:
        frames: some, with the transforms that pose the body in them; none where the body's
            surface is not known.
    """
    hair = hair_of_unseen_sides(
        frames,
        splats.surface,
        splats.first,
        splats.kinds,
        held_colours(found, splats.kinds, splats.first.normals),
        skeleton,
    )
    kinds = np.where(hair.covered, KINDS.index("scalp"), splats.kinds)
    splats.parameters = fill_unseen(splats.parameters, found, kinds)
    return hair
