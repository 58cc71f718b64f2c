"""Expressions of a face and hands over a clip, from their landmarks in its frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from capture.body.expressions import (
    FACE_NUMBERS,
    USUAL_REST,
    face_measures,
    face_numbers,
    finger_curls,
    resting_face,
)
from capture.detection.face_and_hands import SIDES, ClipParts
from scene.arrays import Array, Float
from scene.expression import EXPRESSION_COUNT, PARTS

_MIN_MEASURES = 10
"""Frames needed to estimate a person's face at rest."""


def clip_expressions(
    parts: ClipParts, times_s: Float[Array, "F"], takes: Sequence[int]
) -> Float[Array, "F E"]:
    """Expressions in each frame, 0 to 1.

    Where a part is not found they are interpolated between the frames of the same take that show
    it, and at rest if none does: a fist must not open whenever it is missed.
    """
    expressions = np.full((len(times_s), EXPRESSION_COUNT), np.nan)
    for frame, face in enumerate(_faces(parts)):
        if face is not None:
            expressions[frame, :FACE_NUMBERS] = face
    for side, hands in zip(SIDES, parts.hands, strict=True):
        for frame, hand in enumerate(hands):
            if hand is not None:
                expressions[frame, PARTS[f"{side}_hand"]] = finger_curls(hand.landmarks.shape)
    for take in np.unique(takes):
        here = np.asarray(takes) == take
        for number in range(EXPRESSION_COUNT):
            expressions[here, number] = _without_gaps(times_s[here], expressions[here, number])
    return expressions


def _faces(parts: ClipParts) -> list[Float[Array, "E"] | None]:
    measures = [None if face is None else face_measures(face.shape) for face in parts.faces]
    known = [one for one in measures if one is not None]
    rest = resting_face(np.array(known)) if len(known) >= _MIN_MEASURES else USUAL_REST
    return [None if one is None else face_numbers(one, rest) for one in measures]


def _without_gaps(times_s: Float[Array, "F"], values: Float[Array, "F"]) -> Float[Array, "F"]:
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    return np.interp(times_s, times_s[known], values[known])
