"""Landmarks of face and hands in the pictures of a clip, by MediaPipe's landmarkers.

Each runs on a square around the part's body landmarks; in the whole picture a face is often too
small to be detected. The page's twin is `client/src/landmarks/crops.ts`.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.detection.landmarks import ClosedOnExit, Landmarks
from capture.errors import PoseModelMissing
from scene.arrays import Array, Float, UInt8
from scene.rotations import rotation_between

SIDES = ("left", "right")
_HANDS = [
    [LANDMARK_NAMES.index(f"{side}_{part}") for part in ("wrist", "pinky", "index", "thumb")]
    for side in SIDES
]
_MIN_VISIBILITY = 0.5
_AROUND_HEAD, _AROUND_HAND = 1.1, 2.2
"""Half a square's side, in the larger extent of the head's landmarks. Hands that sign fill a
smaller one, and palms are then not detected: 1.6 finds 16 % of them in a clip where this finds
85 %."""
_MIN_CONFIDENCE, _MIN_HAND_CONFIDENCE = 0.3, 0.1
"""A blurred hand is better known roughly than not at all."""
_FARTHEST_WRIST = 0.75
"""From the body's wrist to a hand's, in the head's extent: beyond, it is another hand."""
_OTHER_SIDE = 0.4
"""Distance that a hand seems farther away if the network takes it for one of the other side."""
_SAME_HAND = 0.3
"""Distance of the middles of two findings up to which they are of one hand."""


@dataclass(frozen=True, eq=False)
class PartLandmarks:
    """A face (478 points) or hand (21 points) in a picture."""

    pixels: Float[Array, "P 2"]
    """Of the whole picture, px."""
    shape: Float[Array, "P 3"]
    """Places about the part as it is seen along its own line of sight, x right, y down, z away: px
    for a face, m for a hand."""

    def in_camera(self, focal_px: float, centre: Float[Array, "2"]) -> Float[Array, "P 3"]:
        """`shape` in the axes of the picture's camera, whose principal point is `centre` (px)."""
        middle = (self.pixels.mean(axis=0) - centre) / focal_px
        ray = np.append(middle, 1.0)
        to_ray = rotation_between(np.array([0.0, 0.0, 1.0]), ray / np.linalg.norm(ray))
        return self.shape @ to_ray.T


@dataclass(frozen=True, eq=False)
class FoundHand:
    """A hand, and whether the network, too, takes it for the side that it was assigned to."""

    landmarks: PartLandmarks
    side_agreed: bool


@dataclass(frozen=True, eq=False)
class ClipParts:
    """What was found in each frame of a clip; None where nothing was."""

    faces: list[PartLandmarks | None]
    hands: tuple[list[FoundHand | None], list[FoundHand | None]]
    """Left and right, the person's own."""

    def at(self, frames: Sequence[int]) -> ClipParts:
        """The same of some `frames`."""
        left, right = ([side[frame] for frame in frames] for side in self.hands)
        return ClipParts([self.faces[frame] for frame in frames], (left, right))


_Hands = tuple[FoundHand | None, FoundHand | None]
"""The left and the right one."""


class FaceAndHandDetector(ClosedOnExit):
    """Looks at one person, picture by picture. Use it as a context, or `close` it.

    Raises PoseModelMissing if a file is not a model.
    """

    def __init__(self, face_model: Path | None, hand_model: Path | None) -> None:
        """With the models available; without one its part is never found."""
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
                    HandLandmarkerOptions(
                        base_options=BaseOptions(model_asset_path=str(hand_model)),
                        num_hands=2,
                        min_hand_detection_confidence=_MIN_HAND_CONFIDENCE,
                        min_hand_presence_confidence=_MIN_HAND_CONFIDENCE,
                    )
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

    def face(self, image: UInt8[Array, "H W 3"], person: Landmarks) -> PartLandmarks | None:
        """The face of `person`, if it is found. About 8 ms on one core."""
        head = person.pixels[:FACE_LANDMARKS]
        middle = 0.5 * (head.min(axis=0) + head.max(axis=0))
        return self.face_about(image, middle, _AROUND_HEAD * _extent(person))

    def face_about(
        self, image: UInt8[Array, "H W 3"], middle: Float[Array, "2"], half_px: float
    ) -> PartLandmarks | None:
        """The face in the square about `middle` whose half side is `half_px`."""
        square = _square(middle, half_px)
        if self._faces is None or square is None:
            return None
        found = self._faces.detect(_crop(image, square)).face_landmarks
        return _of_face(found[0], square) if found else None

    def hands(self, image: UInt8[Array, "H W 3"], person: Landmarks) -> _Hands:
        """The left and the right hand of `person`. About 20 ms on one core.

        A square often shows both: all that is found in either is assigned to the wrists together.
        """
        extent = _extent(person)
        seen: list[tuple[PartLandmarks, str]] = []
        for points in _HANDS:
            middle = person.pixels[points].mean(axis=0)
            inside = (middle >= 0).all() and (middle <= [image.shape[1], image.shape[0]]).all()
            shown = inside and person.visibility[points].min() >= _MIN_VISIBILITY
            square = _square(middle, _AROUND_HAND * extent) if shown else None
            if self._hands is None or square is None:
                continue
            found = self._hands.detect(_crop(image, square))
            seen += [
                (_of_hand(flat, world, square), side[0].category_name.lower())
                for flat, world, side in zip(
                    found.hand_landmarks, found.hand_world_landmarks, found.handedness, strict=True
                )
            ]
        wrists = person.pixels[[points[0] for points in _HANDS]]
        return assign_hands(seen, wrists, extent)


class PartsAside(ClosedOnExit):
    """Looks at one person's face and hands in a thread of its own. Use it as a context.

    Raises PoseModelMissing if a file is not a model.
    """

    def __init__(self, face_model: Path | None, hand_model: Path | None) -> None:
        """As `FaceAndHandDetector`."""
        self._detector = FaceAndHandDetector(face_model, hand_model)
        self._thread = ThreadPoolExecutor(1, "parts")
        self._looks: dict[int, Future[tuple[PartLandmarks | None, _Hands]]] = {}

    def look(self, frame: int, image: UInt8[Array, "H W 3"], person: Landmarks) -> None:
        """Have it look at `person` in the `image` of a frame, after those of before."""
        self._looks[frame] = self._thread.submit(self._look, image, person)

    def found(self, frames: int) -> ClipParts:
        """Wait for what it finds in the first so many frames; nothing where it was not to look."""
        nothing = (None, (None, None))
        seen = [
            self._looks[frame].result() if frame in self._looks else nothing
            for frame in range(frames)
        ]
        left, right = ([hands[side] for _, hands in seen] for side in range(2))
        return ClipParts([face for face, _ in seen], (left, right))

    def close(self) -> None:
        """Look at no more, and free the networks."""
        self._thread.shutdown(cancel_futures=True)
        self._detector.close()

    def _look(
        self, image: UInt8[Array, "H W 3"], person: Landmarks
    ) -> tuple[PartLandmarks | None, _Hands]:
        return self._detector.face(image, person), self._detector.hands(image, person)


def assign_hands(
    seen: list[tuple[PartLandmarks, str]], wrists: Float[Array, "2 2"], extent: float
) -> tuple[FoundHand | None, FoundHand | None]:
    """The hands that lie nearest to the left and right of `wrists` (px).

    `seen` are hands, each with the side that the network takes it for; `extent` is the head's, px.
    """
    best: tuple[FoundHand | None, FoundHand | None] = None, None
    least = 2.0 * _FARTHEST_WRIST
    costs = np.full((2, len(seen) + 1), _FARTHEST_WRIST)
    for side, name in enumerate(SIDES):
        for place, (hand, said) in enumerate(seen):
            far = float(np.linalg.norm(hand.pixels[0] - wrists[side])) / extent
            costs[side, place] = far + (0.0 if said == name else _OTHER_SIDE)
    for left in range(len(seen) + 1):
        for right in range(len(seen) + 1):
            cost = float(costs[0, left] + costs[1, right])
            if cost >= least or _are_one(
                [seen[i][0] for i in (left, right) if i < len(seen)], extent
            ):
                continue
            least = cost
            pair = [
                None if place == len(seen) else FoundHand(seen[place][0], seen[place][1] == name)
                for place, name in zip((left, right), SIDES, strict=True)
            ]
            best = pair[0], pair[1]
    return best


def _are_one(hands: list[PartLandmarks], extent: float) -> bool:
    if len(hands) < 2:
        return False
    between = hands[0].pixels.mean(axis=0) - hands[1].pixels.mean(axis=0)
    return float(np.linalg.norm(between)) < _SAME_HAND * extent


def _extent(person: Landmarks) -> float:
    """The larger extent of the head's landmarks, px."""
    return max(float(np.ptp(person.pixels[:FACE_LANDMARKS], axis=0).max()), 1e-6)


def _square(middle: Float[Array, "2"], half_px: float) -> tuple[int, int, int] | None:
    """Left, top and side, px; None for a point."""
    side = round(2.0 * half_px) if np.isfinite(half_px) else 0
    if side < 2:
        return None
    x, y = np.rint(middle - half_px).astype(int)
    return int(x), int(y), side


def _of_face(points, square: tuple[int, int, int]) -> PartLandmarks:
    x, y, side = square
    shape = side * np.array([[p.x, p.y, p.z] for p in points])
    return PartLandmarks(shape[:, :2] + [x, y], shape)


def _of_hand(flat, world, square: tuple[int, int, int]) -> PartLandmarks:
    x, y, side = square
    pixels = side * np.array([[p.x, p.y] for p in flat]) + [x, y]
    return PartLandmarks(pixels, np.array([[p.x, p.y, p.z] for p in world]))


def _crop(image: UInt8[Array, "H W 3"], square: tuple[int, int, int]):
    """The square of `image` as MediaPipe takes it; black beyond the picture."""
    from mediapipe import Image, ImageFormat

    x, y, side = square
    shift = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y]])
    pixels = cv2.warpAffine(image, shift, (side, side), flags=cv2.INTER_NEAREST)
    return Image(image_format=ImageFormat.SRGB, data=np.ascontiguousarray(pixels))
