"""A clip as it is stored: the frames that show the person, cropped round them, body and motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from capture.detection.tracking import Track
from capture.errors import NoPersonFound
from capture.fitting.result import Fit
from capture.fitting.world import PlacedFit
from capture.overlay import draw_overlay
from capture.segmentation.foreground import premultiplied
from capture.segmentation.masks import mask_bounds
from scene.arrays import Array, Float, UInt8
from scene.body import Body
from scene.camera import Camera
from scene.motion import Motion
from scene.sequence import Frame

_FAINT, _CROP_MARGIN = 0.1, 0.06


@dataclass(frozen=True, eq=False)
class CapturedClip:
    """One person, one still camera, F frames."""

    images: Sequence[UInt8[Array, "H W 3"]]
    masks: Sequence[Float[Array, "H W"]]
    camera: Camera
    body: Body
    motion: Motion
    landmark_error_px: Float[Array, "F 33"]
    """NaN where a landmark was not seen."""
    frames_lost: int
    takes: int
    legs_seen: bool

    def frames(self, on_progress: Callable[[float], None]) -> Iterator[Frame]:
        """As they are stored: of each picture only the person is kept."""
        for index, image in enumerate(self.images):
            on_progress(index / len(self.images))
            mask = self.masks[index]
            yield Frame(premultiplied(image, mask), mask, self.camera, self.motion.pose(index))

    def overlays(self) -> Iterator[UInt8[Array, "h w 3"]]:
        """Whole pictures, with all that was found drawn over them."""
        for index, image in enumerate(self.images):
            pixels = image.astype(np.float32) / np.float32(255.0)
            frame = Frame(pixels, self.masks[index], self.camera, self.motion.pose(index))
            yield draw_overlay(frame, self.body)


def crop_to_person(
    images: Sequence[UInt8[Array, "H W 3"]],
    track: Track,
    masks: Sequence[Float[Array, "H W"] | None],
    fit: Fit,
    placed: PlacedFit,
    size_px: int,
) -> CapturedClip:
    """The frames in which the person was found, cropped round all of them.

    Pictures are made smaller until their longest side is `size_px`, never larger. Raises
    NoPersonFound where all masks are empty.
    """
    height, width = images[0].shape[:2]
    found_frames = np.flatnonzero(track.found).tolist()
    window = mask_bounds(masks, _FAINT, _CROP_MARGIN)
    if window is None:
        raise NoPersonFound(
            "the person's mask must not be empty; got nothing in any frame; film against a plain, "
            "well lit background"
        )
    x, y, w, h = window
    scale = min(1.0, size_px / max(w, h))
    target = (max(1, round(w * scale)), max(1, round(h * scale)))

    def cropped(picture: Array) -> Array:
        return cv2.resize(picture[y : y + h, x : x + w], target, interpolation=cv2.INTER_AREA)

    intrinsics = np.array(
        [[fit.focal_px, 0.0, 0.5 * width], [0.0, fit.focal_px, 0.5 * height], [0.0, 0.0, 1.0]]
    )
    camera = Camera(intrinsics, placed.world_to_camera, width, height)
    motion = placed.motion
    return CapturedClip(
        [cropped(images[index]) for index in found_frames],
        [cropped(mask) for index in found_frames if (mask := masks[index]) is not None],
        camera.cropped(x, y, w, h).resized(*target),
        placed.body,
        Motion(
            motion.times_s[found_frames],
            motion.joint_angles[found_frames],
            motion.root_translation[found_frames],
            motion.confidence[found_frames],
            motion.expressions[found_frames],
        ),
        fit.landmark_error_px[found_frames] * scale,
        len(images) - len(found_frames),
        track.takes[-1] + 1,
        placed.legs_seen,
    )
