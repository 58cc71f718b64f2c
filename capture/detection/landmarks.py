"""Landmarks and masks of the people in a picture: the estimator's Protocol, and MediaPipe."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from capture.errors import PoseModelMissing
from scene.arrays import Array, Float, UInt8


@dataclass(frozen=True, eq=False)
class Landmarks:
    """One person in one picture."""

    pixels: Float[Array, "33 2"]
    """Where each landmark is seen, px; outside the picture where it is guessed."""
    world: Float[Array, "33 3"]
    """m, origin between the hips, axes of the camera: x right, y down, z away from it."""
    visibility: Float[Array, "33"]
    """0 (hidden or outside) to 1 (seen)."""
    mask: Float[Array, "H W"]
    """Soft alpha of the person in [0, 1], as large as the picture."""

    @property
    def box(self) -> Float[Array, "4"]:
        """Left, top, right, bottom of the landmarks, px."""
        return np.concatenate([self.pixels.min(axis=0), self.pixels.max(axis=0)])

    def moved(self, x: float, y: float, width: int, height: int) -> Landmarks:
        """The same person in a picture `width` x `height` whose window at (x, y) was searched."""
        mask = np.zeros((height, width), dtype=np.float32)
        h, w = self.mask.shape
        mask[int(y) : int(y) + h, int(x) : int(x) + w] = self.mask
        return Landmarks(self.pixels + np.array([x, y]), self.world, self.visibility, mask)


class PoseEstimator(Protocol):
    """Finds people in one picture. Any estimator fits that can give MediaPipe's 33 landmarks."""

    def detect(self, image: UInt8[Array, "H W 3"]) -> list[Landmarks]:
        """Everybody found in the sRGB `image`, in no particular order; maybe nobody."""
        ...


class ClosedOnExit:
    """Something to be used as a context, or closed."""

    def close(self) -> None:
        """Free what it holds."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class MediaPipeEstimator(ClosedOnExit):
    """MediaPipe's Pose Landmarker. Pictures are independent: tracking is
    `capture.detection.tracking`'s.

    Use it as a context, or `close` it. Raises PoseModelMissing if `model_path` is not a model.
    """

    def __init__(self, model_path: Path, *, people: int = 4, min_confidence: float = 0.3) -> None:
        # imported here: it takes a second, and keypoints or the studio need none of it
        from mediapipe.tasks.python import BaseOptions
        from mediapipe.tasks.python.vision import (
            PoseLandmarker,
            PoseLandmarkerOptions,
            RunningMode,
        )

        options = PoseLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=str(model_path)),
            running_mode=RunningMode.IMAGE,
            num_poses=people,
            min_pose_detection_confidence=min_confidence,
            min_pose_presence_confidence=min_confidence,
            output_segmentation_masks=True,
        )
        try:
            self._landmarker = PoseLandmarker.create_from_options(options)
        except (RuntimeError, ValueError, OSError) as error:
            raise PoseModelMissing(
                f"the pose model must be a MediaPipe .task file; got {model_path} ({error}); set "
                "METANERF_POSE_MODEL to a pose_landmarker_full.task"
            ) from error

    def close(self) -> None:
        """Free the networks."""
        self._landmarker.close()

    def detect(self, image: UInt8[Array, "H W 3"]) -> list[Landmarks]:
        """See PoseEstimator. 30-40 ms on one core."""
        from mediapipe import Image, ImageFormat

        pixels = np.ascontiguousarray(image)
        found = self._landmarker.detect(Image(image_format=ImageFormat.SRGB, data=pixels))
        size = np.array([image.shape[1], image.shape[0]], dtype=np.float64)
        masks = found.segmentation_masks or []
        return [
            Landmarks(
                np.array([[p.x, p.y] for p in flat]) * size,
                np.array([[p.x, p.y, p.z] for p in world]),
                np.array([p.visibility for p in flat], dtype=np.float64),
                np.array(mask.numpy_view(), dtype=np.float32).reshape(image.shape[:2]),
            )
            for flat, world, mask in zip(
                found.pose_landmarks, found.pose_world_landmarks, masks, strict=False
            )
        ]
