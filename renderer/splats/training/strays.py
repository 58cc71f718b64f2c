"""Finger splats that have the colour of what was behind the hand.

Fingers are hardly ever quite where the estimated pose has them, and where a gap between them shows
a black shirt, splats that should lie on a finger learn black: a hand turned a little has black
fingertips. Skin is about one colour all over a hand, so whoever is far from it was never seen.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR
from renderer.splats.training.evidence import Evidence
from renderer.splats.training.surface_kinds import strongest_joints
from scene.arrays import Array, Bool, Float
from scene.skeleton import JOINT_NAMES

_HANDS = [JOINT_NAMES.index(f"{side}_hand") for side in ("left", "right")]
_DARKER = np.log(0.5)
"""Mean logarithm of the channels against the hand's median: shadows between fingers are lighter."""
_OTHER_HUE = 0.35
"""How far the logarithms of the channels lie from their mean, together, against the median's."""
_BLACK = 0.05
"""Added to channels (sRGB): of what is nearly black noise makes any hue."""


def strays_on_hands(
    parameters: Float[Array, "N P"], evidence: Evidence, joints: Array, weights: Float[Array, "N 4"]
) -> Bool[Array, "N"]:
    """Splats of fingers and palms whose colour is none of their hand's.

    Args:
        joints: [N 4], by `weights`.
    """
    strays = np.zeros(len(parameters), bool)
    strongest = strongest_joints(joints, weights)
    for hand in _HANDS:
        mine = np.flatnonzero(strongest == hand)
        if not evidence.facing[mine].any():
            continue
        logarithms = np.log(
            np.clip(parameters[mine, COLOUR : COLOUR + 3], 0.0, 1.0).astype(np.float64) + _BLACK
        )
        off = logarithms - _weighted_median(logarithms, evidence.facing[mine])
        brightness = off.mean(axis=1)
        hue = np.linalg.norm(off - brightness[:, None], axis=1)
        strays[mine] = (brightness < _DARKER) | (hue > _OTHER_HUE)
    return strays


def _weighted_median(values: Float[Array, "N C"], weights: Float[Array, "N"]) -> Float[Array, "C"]:
    """Of each column."""
    order = np.argsort(values, axis=0)
    below = np.cumsum(weights[order], axis=0)
    middle = (below < 0.5 * below[-1]).sum(axis=0)
    return np.take_along_axis(values, order, axis=0)[middle, np.arange(values.shape[1])]
