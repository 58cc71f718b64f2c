"""A clip as it is stored: the frames that show the person, cropped round them, body and motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from capture.detection.tracking import Track
from capture.errors import NoPersonFound
from capture.fitting.result import Fit
from capture.fitting.world import PlacedFit
from capture.overlay import draw_overlay
from capture.segmentation.foreground import premultiplied
from capture.segmentation.masks import mask_bounds
from capture.sources.video import Window, shrink
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

    def shrunk(self, size_px: int) -> CapturedClip:
        """The same with pictures of at most `size_px` a side."""
        images = [shrink(image, size_px) for image in self.images]
        height, width = images[0].shape[:2]
        return replace(
            self,
            images=images,
            masks=[shrink(mask, size_px) for mask in self.masks],
            camera=self.camera.resized(width, height),
            landmark_error_px=self.landmark_error_px * (height / self.camera.height),
        )

    def overlays(self) -> Iterator[UInt8[Array, "h w 3"]]:
        """Whole pictures, with all that was found drawn over them."""
        for index, image in enumerate(self.images):
            pixels = image.astype(np.float32) / np.float32(255.0)
            frame = Frame(pixels, self.masks[index], self.camera, self.motion.pose(index))
            yield draw_overlay(frame, self.body)


def person_window(masks: Sequence[Float[Array, "h w"] | None], filmed: tuple[int, int]) -> Window:
    """What holds the person in all frames, in px of pictures of the size `filmed` (width, height),
    of which the masks may be smaller versions.

    Raises NoPersonFound where all masks are empty.
    """
    bounds = mask_bounds(masks, _FAINT, _CROP_MARGIN)
    if bounds is None:
        raise NoPersonFound(
            "the person's mask must not be empty; got nothing in any frame; film against a plain, "
            "well lit background"
        )
    height, width = next(mask.shape for mask in masks if mask is not None)
    x, y, w, h = bounds
    across, down = filmed[0] / width, filmed[1] / height
    return (
        slice(round(down * y), round(down * (y + h))),
        slice(round(across * x), round(across * (x + w))),
    )


def working_camera(fit: Fit, placed: PlacedFit, width: int, height: int) -> Camera:
    """The camera of the whole pictures, of `width` x `height` px, that the capture works with."""
    intrinsics = np.array(
        [[fit.focal_px, 0.0, 0.5 * width], [0.0, fit.focal_px, 0.5 * height], [0.0, 0.0, 1.0]]
    )
    return Camera(intrinsics, placed.world_to_camera, width, height)


def crop_to_person(
    images: Sequence[UInt8[Array, "H W 3"]],
    window: Window,
    filmed: tuple[int, int],
    track: Track,
    masks: Sequence[Float[Array, "h w"] | None],
    fit: Fit,
    placed: PlacedFit,
) -> CapturedClip:
    """The frames in which the person was found.

    Args:
        images: all frames, cut to `window` of pictures of the size `filmed`, at the size at which
            they are stored.
        masks, fit: of the whole pictures, at the size that the capture worked with.
    """
    found_frames = np.flatnonzero(track.found).tolist()
    stored_height, stored_width = images[0].shape[:2]
    rows, columns = window

    def cut(mask: Float[Array, "h w"]) -> Float[Array, "H W"]:
        whole = cv2.resize(mask, filmed, interpolation=cv2.INTER_LINEAR)
        size = (stored_width, stored_height)
        return cv2.resize(whole[window], size, interpolation=cv2.INTER_AREA)

    height, width = next(mask.shape for mask in masks if mask is not None)
    whole = working_camera(fit, placed, width, height).resized(*filmed)
    size = (columns.stop - columns.start, rows.stop - rows.start)
    camera = whole.cropped(columns.start, rows.start, *size).resized(stored_width, stored_height)
    motion = placed.motion
    return CapturedClip(
        [images[index] for index in found_frames],
        [cut(mask) for index in found_frames if (mask := masks[index]) is not None],
        camera,
        placed.body,
        Motion(
            motion.times_s[found_frames],
            motion.joint_angles[found_frames],
            motion.root_translation[found_frames],
            motion.confidence[found_frames],
            motion.expressions[found_frames],
        ),
        fit.landmark_error_px[found_frames] * (camera.focal_px / fit.focal_px),
        len(images) - len(found_frames),
        track.takes[-1] + 1,
        placed.legs_seen,
    )
