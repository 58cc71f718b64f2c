"""Expressions: what a face and fingers do beyond the 24 joints, as a few numbers from 0 to 1.

They are few because a webcam's landmarks drive them. Left and right are the person's own. A model
that knows them moves its splats at rest by the sum of each number times an offset; one that does
not ignores them.
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float

EXPRESSION_NAMES: tuple[str, ...] = (
    "jaw_open",
    "blink_left",
    "blink_right",
    "brows_up",
    "smile",
    "left_hand_curl",
    "right_hand_curl",
)
"""0: at rest (mouth shut, eyes open, brows and mouth at ease, hand flat); 1: fully."""
EXPRESSION_COUNT = len(EXPRESSION_NAMES)


def neutral() -> Float[Array, "E"]:
    """The face and hands at rest."""
    return np.zeros(EXPRESSION_COUNT)
