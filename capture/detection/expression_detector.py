"""Expressions of face and hands in the pictures of a clip, by MediaPipe's landmarkers.

Each runs on a square around the part's body landmarks; in the whole picture a face is often too
small to be detected. The page's twin is `client/src/landmarks/crops.ts`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from capture.body.expressions import (
    FACE_NUMBERS,
    USUAL_REST,
    face_measures,
    face_numbers,
    finger_curls,
    resting_face,
)
from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.detection.landmarks import Landmarks
from capture.errors import PoseModelMissing
from scene.arrays import Array, Float, UInt8
from scene.expression import EXPRESSION_COUNT, PARTS

_HANDS = {
    f"{side}_hand": [
        LANDMARK_NAMES.index(f"{side}_{part}") for part in ("wrist", "pinky", "index", "thumb")
    ]
    for side in ("left", "right")
}
_MIN_VISIBILITY = 0.5
_AROUND_HEAD, _AROUND_HAND = 1.1, 1.6
"""Half a square's side, in the larger extent of the head's landmarks."""
_MIN_CONFIDENCE = 0.3
_MIN_MEASURES = 10
"""Frames needed to estimate a person's face at rest."""


class ExpressionDetector:
    """Measures one person, picture by picture; `close` it (`contextlib.closing`).

    Raises PoseModelMissing if a file is not a model.
    """

    def __init__(self, face_model: Path | None, hand_model: Path | None) -> None:
        """With the models available; without one its numbers stay unknown."""
        # imported here: it takes a second, and the studio needs none of it
        from mediapipe.tasks.python import BaseOptions
        from mediapipe.tasks.python.vision import (
            FaceLandmarker,
            FaceLandmarkerOptions,
            HandLandmarker,
            HandLandmarkerOptions,
        )

        self._faces, self._hands = None, None
        path = face_model
        try:
            if face_model is not None:
                self._faces = FaceLandmarker.create_from_options(
                    FaceLandmarkerOptions(
                        base_options=BaseOptions(model_asset_path=str(face_model)),
                        min_face_detection_confidence=_MIN_CONFIDENCE,
                        min_face_presence_confidence=_MIN_CONFIDENCE,
                    )
                )
            path = hand_model
            if hand_model is not None:
                self._hands = HandLandmarker.create_from_options(
                    HandLandmarkerOptions(BaseOptions(model_asset_path=str(hand_model)))
                )
        except (RuntimeError, ValueError, OSError) as error:
            self.close()
            raise PoseModelMissing(
                f"a landmark model must be a MediaPipe .task file; got {path} ({error}); set "
                "METANERF_FACE_MODEL to a face_landmarker.task, METANERF_HAND_MODEL to a "
                "hand_landmarker.task"
            ) from error

    def close(self) -> None:
        """Free the networks."""
        for networks in (self._faces, self._hands):
            if networks is not None:
                networks.close()

    def face(self, image: UInt8[Array, "H W 3"], person: Landmarks) -> Float[Array, "5"] | None:
        """See `face_measures`; None where no face is found. About 8 ms on one core."""
        square = _square_around(person, list(range(FACE_LANDMARKS)), _AROUND_HEAD)
        if self._faces is None or square is None:
            return None
        found = self._faces.detect(_crop(image, square)).face_landmarks
        if not found:
            return None
        return face_measures(square[2] * np.array([[p.x, p.y, p.z] for p in found[0]]))

    def hand(
        self, image: UInt8[Array, "H W 3"], person: Landmarks, name: str
    ) -> Float[Array, "5"] | None:
        """See `finger_curls`, of the part `left_hand` or `right_hand`. About 10 ms on one core."""
        points = _HANDS[name]
        if self._hands is None or person.visibility[points].min() < _MIN_VISIBILITY:
            return None
        centre = person.pixels[points].mean(axis=0)
        inside = (centre >= 0).all() and (centre <= [image.shape[1], image.shape[0]]).all()
        square = _square_around(person, points, _AROUND_HAND) if inside else None
        if square is None:
            return None
        found = self._hands.detect(_crop(image, square)).hand_world_landmarks
        return finger_curls(np.array([[p.x, p.y, p.z] for p in found[0]])) if found else None


def clip_expressions(
    images: Sequence[UInt8[Array, "H W 3"]],
    people: Sequence[Landmarks | None],
    detector: ExpressionDetector,
    on_progress: Callable[[float], None] = lambda _: None,
) -> Float[Array, "F E"]:
    """Expressions of one person in each picture, 0 to 1; at rest where not detected.

    Args:
        people: the person in each picture; None where they were lost.
        on_progress: called with the share done; may raise, to stop.
    """
    expressions = np.zeros((len(images), EXPRESSION_COUNT))
    faces: dict[int, Array] = {}
    for index, (image, person) in enumerate(zip(images, people, strict=True)):
        if person is not None:
            if (measures := detector.face(image, person)) is not None:
                faces[index] = measures
            for name in _HANDS:
                if (curls := detector.hand(image, person, name)) is not None:
                    expressions[index, PARTS[name]] = curls
        on_progress((index + 1) / len(images))
    rest = (
        resting_face(np.array(list(faces.values()))) if len(faces) >= _MIN_MEASURES else USUAL_REST
    )
    for index, measures in faces.items():
        expressions[index, :FACE_NUMBERS] = face_numbers(measures, rest)
    return expressions


def _square_around(
    person: Landmarks, points: list[int], margin: float
) -> tuple[int, int, int] | None:
    """Left, top and side, px, of a square about some of the landmarks; None for a point."""
    half = margin * float(np.ptp(person.pixels[:FACE_LANDMARKS], axis=0).max())
    side = round(2.0 * half)
    if side < 2 or not np.isfinite(half):
        return None
    low, high = person.pixels[points].min(axis=0), person.pixels[points].max(axis=0)
    x, y = np.rint(0.5 * (low + high) - half).astype(int)
    return int(x), int(y), side


def _crop(image: UInt8[Array, "H W 3"], square: tuple[int, int, int]):
    """The square of `image` as MediaPipe takes it; black beyond the picture."""
    from mediapipe import Image, ImageFormat

    x, y, side = square
    shift = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y]])
    pixels = cv2.warpAffine(image, shift, (side, side), flags=cv2.INTER_NEAREST)
    return Image(image_format=ImageFormat.SRGB, data=np.ascontiguousarray(pixels))
