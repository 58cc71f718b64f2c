"""Expressions: what a face and fingers do beyond the 24 joints, as a few numbers from 0 to 1.

They are few because a webcam's landmarks drive them. Left and right are the person's own. A model
that knows them moves its splats at rest by the sum of each blend shape's weight times its offset;
one that does not ignores them. Each number is the weight of one blend shape. A finger has a second,
an in-between, since its tip goes along an arc: straight from flat to fist it would be short by half
its length on the way.
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

BLEND_SHAPE_COUNT = EXPRESSION_COUNT + 2 * len(FINGERS)
"""Those of each number, then the in-betweens of the fingers' curls, in the same order."""

_EARLIER_REPEATS = (*[1] * len(_FACE_NAMES), len(FINGERS), len(FINGERS))
EARLIER_COUNT = len(_EARLIER_REPEATS)
"""Numbers that earlier versions stored: the face's, and one curl a hand."""


def neutral() -> Float[Array, "E"]:
    """The face and hands at rest."""
    return np.zeros(EXPRESSION_COUNT)


def blend_shape_weights(expression: Float[Array, "*F E"]) -> Float[Array, "*F S"]:
    """Weights of the blend shapes: the numbers, then 4 c (1 - c) of each finger's curl c.

    Where the curl is a half, the finger lies at half of its first shape and all of its second; the
    parabola through these places stands in for the arc.
    """
    curls = expression[..., _LEFT:]
    return np.concatenate([expression, 4.0 * curls * (1.0 - curls)], axis=-1)


def values_of_any_version(stored: Float[Array, "*F X"]) -> Float[Array, "*F E"]:
    """Values as any version stored them: a hand's one curl becomes that of each of its fingers."""
    if stored.shape[-1:] != (EARLIER_COUNT,):
        return stored
    return np.repeat(stored, _EARLIER_REPEATS, axis=-1)


def offsets_of_any_version(stored: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """Offsets as any version stored them, blend shapes along `axis`: each finger takes an equal
    share of its hand's, so that all of them together move it as far; in-betweens move nothing."""
    if stored.shape[axis : axis + 1] == (EARLIER_COUNT,):
        shares = np.repeat(_EARLIER_REPEATS, _EARLIER_REPEATS).astype(stored.dtype)
        stored = np.repeat(stored, _EARLIER_REPEATS, axis=axis)
        stored = stored / np.expand_dims(shares, tuple(range(1, stored.ndim - axis)))
    if stored.shape[axis : axis + 1] != (EXPRESSION_COUNT,):
        return stored
    missing = [(0, 0)] * stored.ndim
    missing[axis] = (0, BLEND_SHAPE_COUNT - EXPRESSION_COUNT)
    return np.pad(stored, missing)
