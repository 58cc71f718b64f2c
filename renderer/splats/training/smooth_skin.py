"""Makes skin smooth that frames only graze: cheeks, temples and necks of people who hardly turn.

Splats there take whatever the last pixels of an outline show, of hair, of collars, of the
background, and fit frames best so. From beside, that is a face full of spots.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, POSITION
from renderer.splats.training.evidence import Evidence
from renderer.splats.training.filling import evidence_weights, smoothest
from renderer.splats.training.neighbours import neighbours_at_rest
from renderer.splats.training.surface_kinds import KINDS
from scene.arrays import Array, Bool, Float, Int

_SKIN = [KINDS.index("face"), KINDS.index("neck")]
_SHOWN = 0.1
"""Evidence at which a splat's own colour weighs as much as one neighbour's, where one that lies
open has 1 px, and one at a rim at most a third. Evidence from frames that a splat faces alone
would smooth what the front is made of as well: hair that hangs over a cheek, the edge of a jaw."""
_OWN = 0.1
"""Least weight: where hardly anything is shown, as under a strand of hair, hair and skin stay
apart."""
_COLOURS, _PLACE = slice(COLOUR, COLOUR + 3), slice(POSITION, POSITION + 3)


def smooth_skin(
    parameters: Float[Array, "N P"],
    evidence: Evidence,
    kinds: Int[Array, "N"],
    covered: Bool[Array, "N"],
) -> Float[Array, "N P"]:
    """`parameters` with the smoothest colours of seen faces and necks that agree with what frames
    show. Not while training goes on: splats beside would take over what these no longer show.

    Args:
        kinds: index into `KINDS`, as of `surface_kinds`.
        covered: by hair.
    """
    rows = np.flatnonzero(np.isin(kinds, _SKIN) & evidence.seen & ~covered)
    if len(rows) < 2:
        return parameters
    weights = evidence_weights(evidence.pixels[rows], _SHOWN * evidence.open_px) + _OWN
    colours = parameters[rows, _COLOURS].astype(np.float64)
    smooth = parameters.copy()
    edges = neighbours_at_rest(parameters[rows, _PLACE])
    smooth[rows, _COLOURS] = smoothest(edges, weights, weights[:, None] * colours)
    return smooth
