"""Finer splats for sides that no frame shows, once it is known which these are.

Until then they are few and wide, since no picture asks for more. Wide ones end a person's outline
softly, as flat splats stand off a round limb, and the front shows through where they lie apart. So
a finer layer on the body's surface takes their place, and the rest of the training fits its rim.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import LOG_SCALE, POSITION
from renderer.splats.training.initialisation import FirstSplats, SurfacePlaces, splats_at
from renderer.splats.unseen import capture_weight
from scene.arrays import Array, Bool, Float
from scene.body import Body

_DENSITY = 14_000.0
"""Splats a square metre of such a side."""
_SCALE_SHARE = 1.0
"""Deviation as a share of the spacing: hardly any picture trains them to close gaps."""
_WIDE_M = 0.009
"""Deviation from which a splat is wide."""


def wide_on_unseen_sides(
    parameters: Float[Array, "N P"], seen: Bool[Array, "N"]
) -> Bool[Array, "N"]:
    """Splats that `finer_layer` is to replace: wide ones of unseen sides, but for those of parts
    that were never filmed, which fade out."""
    rest = parameters[:, POSITION : POSITION + 3]
    wide = np.exp(parameters[:, LOG_SCALE : LOG_SCALE + 3].max(axis=1)) > _WIDE_M
    return ~seen & wide & (capture_weight(rest, seen) > 0.0)


def finer_layer(body: Body, thickness: float) -> FirstSplats:
    """Evenly over the whole surface of `body`, the same for the same body.

    Args:
        thickness: see `SplatSettings`.
    """
    places = SurfacePlaces.even(body, _DENSITY, np.random.default_rng(0))
    return splats_at(places, body, _SCALE_SHARE / float(np.sqrt(_DENSITY)), thickness)
