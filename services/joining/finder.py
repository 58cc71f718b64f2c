"""Finds one person's landmarks in picture after picture, as a page does in its webcam's."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import NamedTuple

import numpy as np

from capture.body.expressions import (
    FACE,
    LEFT_HAND,
    RIGHT_HAND,
    USUAL_REST,
    ObservedExpression,
    face_measures,
    face_numbers,
    finger_curls,
    resting_face,
)
from capture.detection.face_and_hands import SIDES, FaceAndHandDetector, PartLandmarks
from capture.detection.landmarks import ClosedOnExit, Landmarks, MediaPipeEstimator
from capture.detection.rigid_parts import head_rotation
from scene.arrays import Array, Float, UInt8
from scene.expression import EXPRESSION_COUNT, PARTS
from services.live.motion.solved_motion import usual_camera

_REST_FACES, _LEAST_FACES = 300, 10
"""Faces by which the one at rest is known, and the fewest that tell it."""
_HAND_BITS = {"left": LEFT_HAND, "right": RIGHT_HAND}


class FoundPerson(NamedTuple):
    """What one picture shows."""

    body: Landmarks
    """With the person's mask."""
    expression: ObservedExpression
    """Of this picture, and of the one before what this one was not searched for."""
    head: Float[Array, "3 3"] | None
    """Its rotation by the face's points, from rest to the camera; None where this picture was not
    searched for a face, or shows none."""


class PersonFinder(ClosedOnExit):
    """Use it as a context, or `close` it; on one thread.

    Face and hands take turns, so that bodies are found as often as can be.
    """

    def __init__(self, pose_model: Path, face_model: Path | None, hand_model: Path | None) -> None:
        """Raises PoseModelMissing if a file is not a model; without one its part is not found."""
        self._bodies = MediaPipeEstimator(pose_model, people=1)
        self._details = FaceAndHandDetector(face_model, hand_model)
        self._measures: deque[Float[Array, "6"]] = deque(maxlen=_REST_FACES)
        self._values, self._known = np.zeros(EXPRESSION_COUNT), 0
        self._pictures = 0

    def close(self) -> None:
        """Free the networks."""
        self._bodies.close()
        self._details.close()

    def find(self, image: UInt8[Array, "H W 3"]) -> FoundPerson | None:
        """Whoever is in the sRGB `image`, the next of the webcam; None: nobody is. 40 to 100 ms on
        one core."""
        found = self._bodies.detect(image)
        if not found:
            self._known = 0
            return None
        self._pictures += 1
        head = None
        if self._pictures % 2:
            face = self._details.face(image, found[0])
            self._learn_expression(face)
            if face is not None:
                height, width = image.shape[:2]
                head = head_rotation(face, usual_camera(width, height))
        else:
            self._look_at_hands(image, found[0])
        return FoundPerson(found[0], ObservedExpression(self._values.copy(), self._known), head)

    def _learn_expression(self, face: PartLandmarks | None) -> None:
        self._known &= ~FACE
        measures = None if face is None else face_measures(face.shape)
        if measures is None:
            return
        self._measures.append(measures)
        enough = len(self._measures) >= _LEAST_FACES
        rest = resting_face(np.array(self._measures)) if enough else USUAL_REST
        self._values[PARTS["face"]] = face_numbers(measures, rest)
        self._known |= FACE

    def _look_at_hands(self, image: UInt8[Array, "H W 3"], body: Landmarks) -> None:
        for side, hand in zip(SIDES, self._details.hands(image, body), strict=True):
            self._known &= ~_HAND_BITS[side]
            if hand is not None:
                self._values[PARTS[f"{side}_hand"]] = finger_curls(hand.landmarks.shape)
                self._known |= _HAND_BITS[side]
