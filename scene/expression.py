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
_MIMIC_NAMES = ("jaw_open", "blink_left", "blink_right", "brows_up", "smile")
_GAZE_NAMES = ("look_left", "look_right")
EXPRESSION_NAMES: tuple[str, ...] = (
    *_MIMIC_NAMES,
    *_GAZE_NAMES,
    *(f"{side}_{finger}_curl" for side in ("left", "right") for finger in FINGERS),
)
"""0: at rest (mouth shut, eyes open and straight ahead, brows and mouth at ease, hand flat);
1: fully."""
EXPRESSION_COUNT = len(EXPRESSION_NAMES)

_MIMIC = len(_MIMIC_NAMES)
_LEFT = _MIMIC + len(_GAZE_NAMES)
_RIGHT = _LEFT + len(FINGERS)
PARTS = {
    "face": slice(0, _LEFT),
    "left_hand": slice(_LEFT, _RIGHT),
    "right_hand": slice(_RIGHT, EXPRESSION_COUNT),
}
"""Where among the numbers those of each part of the body are."""

CURLS = slice(_LEFT, EXPRESSION_COUNT)
"""Where among them those of all fingers are."""

GAZE = slice(_MIMIC, _LEFT)
"""Where among them those of the eyes are, which turn together."""
GAZE_RAD = 0.5
"""How far eyes turn aside where a number of theirs is 1."""

BLEND_SHAPE_COUNT = EXPRESSION_COUNT + 2 * len(FINGERS)
"""Those of each number, then the in-betweens of the fingers' curls, in the same order."""

_WHOLE_HANDS = (*[1] * _MIMIC, len(FINGERS), len(FINGERS))
EARLIER_COUNTS = (len(_WHOLE_HANDS), EXPRESSION_COUNT - len(_GAZE_NAMES))
"""Numbers that earlier versions stored: one curl a hand and no gaze; no gaze."""


def neutral() -> Float[Array, "E"]:
    """The face and hands at rest."""
    return np.zeros(EXPRESSION_COUNT)


def blend_shape_weights(expression: Float[Array, "*F E"]) -> Float[Array, "*F S"]:
    """Weights of the blend shapes: the numbers, then 4 c (1 - c) of each finger's curl c.

    Where the curl is a half, the finger lies at half of its first shape and all of its second; the
    parabola through these places stands in for the arc.
    """
    curls = expression[..., CURLS]
    return np.concatenate([expression, 4.0 * curls * (1.0 - curls)], axis=-1)


def by_curls(by_weights: Float[Array, "S"], expression: Float[Array, "E"]) -> Float[Array, "C"]:
    """The gradient by the fingers' curls of what has `by_weights` by the weights of the blend
    shapes (see `blend_shape_weights`)."""
    return by_weights[CURLS] + 4.0 * (1.0 - 2.0 * expression[CURLS]) * by_weights[EXPRESSION_COUNT:]


def gaze_of(expression: Float[Array, "*F E"]) -> Float[Array, "*F"]:
    """How far aside the eyes look, to the person's left, rad from straight ahead."""
    left, right = np.moveaxis(expression[..., GAZE], -1, 0)
    return np.asarray((left - right) * GAZE_RAD)


def gaze_numbers(gaze: Float[Array, "*F"]) -> Float[Array, "*F 2"]:
    """The numbers of eyes that look aside by `gaze` (see `gaze_of`), as far as they can turn."""
    return np.clip(np.stack([gaze, -gaze], axis=-1) / GAZE_RAD, 0.0, 1.0)


def values_of_any_version(stored: Float[Array, "*F X"]) -> Float[Array, "*F E"]:
    """Values as any version stored them: a hand's one curl becomes that of each of its fingers,
    and eyes of which nothing was known look straight ahead."""
    if stored.shape[-1:] == (EARLIER_COUNTS[0],):
        stored = np.repeat(stored, _WHOLE_HANDS, axis=-1)
    if stored.shape[-1:] == (EARLIER_COUNTS[1],):
        stored = _with_gaze(stored, axis=stored.ndim - 1)
    return stored


def offsets_of_any_version(stored: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """Offsets as any version stored them, blend shapes along `axis`: each finger takes an equal
    share of its hand's, so that all of them together move it as far; in-betweens and eyes of which
    nothing was known move nothing."""
    if stored.shape[axis : axis + 1] == (EARLIER_COUNTS[0],):
        shares = np.repeat(_WHOLE_HANDS, _WHOLE_HANDS).astype(stored.dtype)
        stored = np.repeat(stored, _WHOLE_HANDS, axis=axis)
        stored = stored / np.expand_dims(shares, tuple(range(1, stored.ndim - axis)))
    if stored.shape[axis : axis + 1] == (EARLIER_COUNTS[1],):
        missing = [(0, 0)] * stored.ndim
        missing[axis] = (0, BLEND_SHAPE_COUNT - EXPRESSION_COUNT)
        stored = np.pad(stored, missing)
    if stored.shape[axis : axis + 1] == (BLEND_SHAPE_COUNT - len(_GAZE_NAMES),):
        stored = _with_gaze(stored, axis)
    return stored


def _with_gaze(stored: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    return np.insert(stored, [_MIMIC] * len(_GAZE_NAMES), 0.0, axis=axis)
