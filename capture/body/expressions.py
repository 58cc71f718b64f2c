"""Expressions (`scene.expression`) of a face and hands, from MediaPipe's landmarks alone.

Lengths within a face, in 3D and as shares of the distance between the outer corners of the eyes,
change with neither distance nor, as far as the landmarks' depth is right, a turn of the head. Their
values at rest differ between people: `resting_face` estimates them from a clip, a page as it runs.
The page's twin is `client/src/landmarks/expression.ts`; both are tested on the same numbers.

Face landmarks: https://ai.google.dev/edge/mediapipe/solutions/vision/face_landmarker (478 points,
ten of them of the irises); hands: the same, hand_landmarker (21 points). Left and right are
the person's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.expression import EXPRESSION_COUNT, PARTS

FACE, LEFT_HAND, RIGHT_HAND = 1, 2, 4
"""Groups of numbers that are seen, or not, together: bits."""
ALL_GROUPS = FACE | LEFT_HAND | RIGHT_HAND
GROUPS = np.zeros(EXPRESSION_COUNT, np.int64)
for _part, _bit in (("face", FACE), ("left_hand", LEFT_HAND), ("right_hand", RIGHT_HAND)):
    GROUPS[PARTS[_part]] = _bit
"""Of each number the group it belongs to."""
FACE_NUMBERS = int((GROUPS == FACE).sum())

SMALLEST_FACE_PX = 40.0
"""From cheek to cheek; landmarks of smaller ones are useless."""
_MAX_TURN_SINE = 0.7
"""Sine of the turn from which the far side of a face is guessed."""

_OUTER_CORNERS = 33, 263  # right, left
_CHEEKS = 234, 454
_LIPS = 13, 14  # inner, upper and lower
_IRISES = 468, 473
"""Middles, of the right eye and the left."""
_MOUTH_CORNERS = 61, 291
_LIDS = {
    "left": ((385, 380), (386, 374), (387, 373)),
    "right": ((160, 144), (159, 145), (158, 153)),
}
_CORNERS = {"left": (362, 263), "right": (33, 133)}
_BROWS_TO_LIDS = (65, 158), (52, 159), (295, 385), (282, 386)
_FOREHEAD, _UNDER_NOSE = 10, 2

_JAW_IN_SMILE = 0.6
"""As a mouth opens its corners sink and draw together: what lips apart give back."""

USUAL_REST = np.array([0.02, 0.27, 0.27, 0.22, -0.2, 0.0])
"""Measures of a face at rest, of people in general."""
_REST_PERCENTILES = (10.0, 65.0, 65.0, 40.0, 30.0, None)
"""Percentiles of a clip's measures that give the face at rest: talk opens a mouth, blinks are
short. Which way straight ahead is does not depend on where somebody looks most."""
_FULL_JAW, _FULL_BROWS, _FULL_SMILE = 0.32, 0.045, 0.2
"""What each measure grows by from rest to fully."""
_IRIS_DEPTH = 0.125
"""How far irises lie before the corners of their eyes, in widths of an eye."""
_FULL_ASIDE = 0.23
"""How far irises have moved where eyes look fully aside, in widths of an eye. Up and down, where
lids hide them, they tell next to nothing."""
_CLOSED = 0.58
"""By which share lids that are shut have come together."""

_CHAINS = np.array([[0, *range(first, first + 4)] for first in (5, 9, 13, 17)])
"""From the wrist to the tip of index, middle, ring and little finger."""
_FLAT, _BENT = 0.95, np.array([0.5, 0.46, 0.46, 0.53])
"""From wrist to tip, as a share of the way along the bones: of fingers held straight, and of each
as far bent as the body model bends it (`tools.build_expressions`). Its own joints are then 0.41,
0.38, 0.37 and 0.46; the landmarks found in pictures of it bend less, to 0.54 to 0.61."""
_THUMB_TIP, _MIDDLE_KNUCKLE, _LITTLE_KNUCKLE = 4, 9, 17
_THUMB_OUT, _THUMB_IN = 1.1, 0.52
"""From the thumb's tip to the little finger's knuckle, in palms' lengths: likewise. A thumb folds
across the palm more than it bends, which its own bones hardly tell."""


@dataclass(frozen=True, eq=False)
class ObservedExpression:
    """Expression observed in one picture."""

    values: Float[Array, "E"]
    """Of `scene.expression.EXPRESSION_NAMES`, 0 to 1; without meaning where not known."""
    known: int
    """Bits of the groups that were seen."""

    @property
    def known_numbers(self) -> Array:
        """Of each number, whether it is known."""
        return (GROUPS & self.known) != 0


def face_measures(points: Float[Array, "478 3"]) -> Float[Array, "6"] | None:
    """Lips apart, left and right lids apart, brows from lids, how wide and high the mouth ends, and
    how far irises are to the person's left.

    Args:
        points: landmarks, px of the picture, z as MediaPipe gives it times the picture's width.

    Returns None for a face that is too small or turned away too far. Lids and irises are shares of
    an eye's width, the others of the distance between the eyes' outer corners."""
    if _distance(points[:, :2], _CHEEKS) < SMALLEST_FACE_PX:
        return None
    across = points[_OUTER_CORNERS[1]] - points[_OUTER_CORNERS[0]]
    span = float(np.linalg.norm(across))
    if abs(float(across[2])) > _MAX_TURN_SINE * span:
        return None
    lids = [
        np.mean([_distance(points, pair) for pair in _LIDS[side]])
        / _distance(points, _CORNERS[side])
        for side in ("left", "right")
    ]
    lips = _distance(points, _LIPS) / span
    brows = np.mean([_distance(points, pair) for pair in _BROWS_TO_LIDS]) / span
    left = across / span
    up = _upward(points, left)
    mouth = points[list(_MOUTH_CORNERS)].mean(axis=0)
    high = float((mouth - _eyes_middle(points)) @ up)
    smile = (_distance(points, _MOUTH_CORNERS) + high) / span
    irises = _irises(points, left, up)
    return np.array([lips, *lids, brows, smile + _JAW_IN_SMILE * lips, irises])


def resting_face(measures: Float[Array, "F 6"]) -> Float[Array, "6"]:
    """The measures of somebody's face at rest, from those of a clip's frames."""
    columns = zip(measures.T, _REST_PERCENTILES, USUAL_REST, strict=True)
    return np.array(
        [usual if share is None else np.percentile(own, share) for own, share, usual in columns]
    )


def face_numbers(measures: Float[Array, "6"], rest: Float[Array, "6"]) -> Float[Array, "7"]:
    """jaw_open, blink_left, blink_right, brows_up, smile, then where the eyes look, each 0 to 1."""
    *moved, aside = measures - rest
    full = np.array([_FULL_JAW, -_CLOSED * rest[1], -_CLOSED * rest[2], _FULL_BROWS, _FULL_SMILE])
    return np.clip([*(moved / full), aside / _FULL_ASIDE, -aside / _FULL_ASIDE], 0.0, 1.0)


def finger_curls(points: Float[Array, "21 3"]) -> Float[Array, "5"]:
    """How far thumb, index, middle, ring and little finger are bent, 0 (flat) to 1 (as in a loose
    fist), from landmarks in any one unit."""
    bones = np.linalg.norm(np.diff(points[_CHAINS], axis=1), axis=2).sum(axis=1)
    shares = np.linalg.norm(points[_CHAINS[:, -1]] - points[0], axis=1) / np.maximum(bones, 1e-9)
    palm = max(_distance(points, (0, _MIDDLE_KNUCKLE)), 1e-9)
    thumb = _distance(points, (_THUMB_TIP, _LITTLE_KNUCKLE)) / palm
    fingers = (_FLAT - shares) / (_FLAT - _BENT)
    return np.clip([(_THUMB_OUT - thumb) / (_THUMB_OUT - _THUMB_IN), *fingers], 0.0, 1.0)


def _distance(points: Array, pair: tuple[int, int]) -> float:
    return float(np.linalg.norm(points[pair[0]] - points[pair[1]]))


def _eyes_middle(points: Float[Array, "N 3"]) -> Float[Array, "3"]:
    return points[[*_CORNERS["left"], *_CORNERS["right"]]].mean(axis=0)


def _upward(points: Float[Array, "N 3"], left: Float[Array, "3"]) -> Float[Array, "3"]:
    """Along the face, unit length."""
    up = points[_FOREHEAD] - points[_UNDER_NOSE]
    up = up - (up @ left) * left
    return up / np.linalg.norm(up)


def _irises(points: Float[Array, "478 3"], left: Float[Array, "3"], up: Float[Array, "3"]) -> float:
    """How far the irises are to the person's left from the middle of their eyes' corners, both eyes
    together, in widths of an eye.

    Their depth is not measured, so only the picture counts: a face that turns moves them aside by
    as much as they lie before the corners.
    """
    width = 0.5 * (_distance(points, _CORNERS["left"]) + _distance(points, _CORNERS["right"]))
    off = (points[list(_IRISES)].mean(axis=0) - _eyes_middle(points)) / width
    ahead = np.cross(left, up)
    off = off[:2] - _IRIS_DEPTH * ahead[:2]
    return float(np.linalg.solve(np.stack([left[:2], up[:2]], axis=1), off)[0])
