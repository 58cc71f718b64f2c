"""What is guessed of sides that no frame shows: their colours, and the hair that covers them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from renderer.splats.training.evidence import Evidence
from renderer.splats.training.filling import fill_unseen, held_colours
from renderer.splats.training.hair import Hair, hair_of_unseen_sides
from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View
from scene.arrays import Array, Float
from scene.skeleton import Skeleton


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
