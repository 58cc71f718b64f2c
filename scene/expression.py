"""Expressions: what a face and fingers do beyond the 24 joints, as a few numbers from 0 to 1.

They are few because a webcam's landmarks drive them. Left and right are the person's own. A model
that knows them moves its splats at rest by the sum of each number times an offset; one that does
not ignores them.
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float

FINGERS = ("thumb", "index", "middle", "ring", "little")
_FACE_NAMES = ("jaw_open", "blink_left", "blink_right", "brows_up", "smile")
EXPRESSION_NAMES: tuple[str, ...] = (
    *_FACE_NAMES,
    *(f"{side}_{finger}_curl" for side in ("left", "right") for finger in FINGERS),
)
"""0: at rest (mouth shut, eyes open, brows and mouth at ease, hand flat); 1: fully."""
EXPRESSION_COUNT = len(EXPRESSION_NAMES)

_LEFT, _RIGHT = len(_FACE_NAMES), len(_FACE_NAMES) + len(FINGERS)
PARTS = {
    "face": slice(0, _LEFT),
    "left_hand": slice(_LEFT, _RIGHT),
    "right_hand": slice(_RIGHT, EXPRESSION_COUNT),
}
"""Where among the numbers those of each part of the body are."""

_EARLIER_REPEATS = (*[1] * len(_FACE_NAMES), len(FINGERS), len(FINGERS))
EARLIER_COUNT = len(_EARLIER_REPEATS)
"""Numbers that earlier versions stored: the face's, and one curl a hand."""


def neutral() -> Float[Array, "E"]:
    """The face and hands at rest."""
    return np.zeros(EXPRESSION_COUNT)


def values_of_any_version(stored: Float[Array, "*F X"]) -> Float[Array, "*F E"]:
    """Values as any version stored them: a hand's one curl becomes that of each of its fingers."""
    if stored.shape[-1:] != (EARLIER_COUNT,):
        return stored
    return np.repeat(stored, _EARLIER_REPEATS, axis=-1)


def offsets_of_any_version(stored: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """Offsets as any version stored them, expressions along `axis`: each finger takes an equal
    share of its hand's, so that all of them together move it as far."""
    if stored.shape[axis : axis + 1] != (EARLIER_COUNT,):
        return stored
    repeated = np.repeat(stored, _EARLIER_REPEATS, axis=axis)
    shares = np.repeat(_EARLIER_REPEATS, _EARLIER_REPEATS).astype(stored.dtype)
    return repeated / np.expand_dims(shares, tuple(range(1, stored.ndim - axis)))
