"""Faces and hands in a picture, found by MediaPipe for the benchmark alone.

Capture has its own way of finding them; a measure must not move when that does.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from scene.arrays import Array, Float, UInt8

FACE_POINTS, HAND_POINTS = 478, 21
LEFT_EYE, RIGHT_EYE = (362, 263), (33, 133)
"""Corners of the person's eyes among the face's points."""
_IRISES = {LEFT_EYE: 473, RIGHT_EYE: 468}
"""The middle of the iris in each eye."""
_NETWORK_SIDE_PX = 512
"""A window is enlarged to this side: the detectors were made for faces that fill a picture."""
_LEAST_CONFIDENCE = 0.5

Window = tuple[int, int, int, int]
"""Left, top, width and height, px."""


@dataclass(frozen=True, eq=False)
class PartFinder:
    """MediaPipe's face and hand landmarkers."""

    _faces: Any
    _hands: Any

    def face(self, image: UInt8[Array, "H W 3"], window: Window) -> Float[Array, "478 2"] | None:
        """Points of the face in the `window` of a picture, px of the picture; None: no face."""
        picture, scale = _enlarged(image, window)
        found = self._faces.detect(picture).face_landmarks
        return _in_picture(found[0], window, scale) if found else None

    def hand(self, image: UInt8[Array, "H W 3"], window: Window) -> Float[Array, "21 2"] | None:
        """Points of the hand in the `window` of a picture, px of the picture; None: no hand."""
        picture, scale = _enlarged(image, window)
        found = self._hands.detect(picture).hand_landmarks
        return _in_picture(found[0], window, scale) if found else None


@contextmanager
def part_finder(face_model: Path, hand_model: Path) -> Iterator[PartFinder]:
    """A finder with the two `.task` files, closed afterwards."""
    # imported here: it takes a second
    from mediapipe.tasks.python import BaseOptions, vision

    faces = vision.FaceLandmarker.create_from_options(
        vision.FaceLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=str(face_model)),
            min_face_detection_confidence=_LEAST_CONFIDENCE,
            min_face_presence_confidence=_LEAST_CONFIDENCE,
        )
    )
    hands = vision.HandLandmarker.create_from_options(
        vision.HandLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=str(hand_model)),
            min_hand_detection_confidence=_LEAST_CONFIDENCE,
            min_hand_presence_confidence=_LEAST_CONFIDENCE,
        )
    )
    with faces, hands:
        yield PartFinder(faces, hands)


def window_around(points: Float[Array, "P 2"], grow: float, least_px: int) -> Window:
    """A square about `points`: `grow` times their larger extent, at least `least_px` a side."""
    low, high = points.min(axis=0), points.max(axis=0)
    side = max(round(grow * float((high - low).max())), least_px)
    x, y = np.rint(0.5 * (low + high) - 0.5 * side).astype(int).tolist()
    return x, y, side, side


def eye_distance(face: Float[Array, "478 2"]) -> float:
    """From the middle of one eye to that of the other, px."""
    middles = [face[list(eye)].mean(axis=0) for eye in (LEFT_EYE, RIGHT_EYE)]
    return float(np.linalg.norm(middles[0] - middles[1]))


def irises_in_eyes(face: Float[Array, "478 2"]) -> Float[Array, "2 2"]:
    """Where each iris lies from the middle of its eye's corners, left eye first, in widths of the
    eye: along the line from the first corner to the second, and at right angles to it.

    Wherever in the picture the head is, and however it is tilted, this is the gaze's alone."""
    found = []
    for corners, iris in _IRISES.items():
        first, second = face[list(corners)]
        across = second - first
        along = across / np.square(across).sum()
        off = face[iris] - 0.5 * (first + second)
        found.append([off @ along, off @ [-along[1], along[0]]])
    return np.array(found)


def _enlarged(image: UInt8[Array, "H W 3"], window: Window) -> tuple[Any, float]:
    from mediapipe import Image, ImageFormat

    x, y, width, height = window
    scale = _NETWORK_SIDE_PX / max(width, height)
    affine = np.array([[scale, 0.0, -scale * x], [0.0, scale, -scale * y]])
    size = (round(scale * width), round(scale * height))
    pixels = cv2.warpAffine(image, affine, size, flags=cv2.INTER_LINEAR)
    return Image(image_format=ImageFormat.SRGB, data=np.ascontiguousarray(pixels)), scale


def _in_picture(points: Any, window: Window, scale: float) -> Float[Array, "P 2"]:
    size = np.array([round(scale * window[2]), round(scale * window[3])])
    inside = np.array([[point.x, point.y] for point in points]) * size / scale
    return inside + np.array(window[:2])
