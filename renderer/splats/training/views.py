"""The training frames as the kernels take them: cropped to the body, 8 bits, cameras packed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.splats.rasteriser.workspace import pack_camera
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.sequence import FrameSource, body_crop

_CROP_MARGIN = 0.12
"""Share of the body's box kept round it: room where splats that stray are still punished."""


@dataclass(frozen=True, eq=False)
class View:
    """One training frame, cropped to the body."""

    rgba: UInt8[Array, "H W 4"]
    window: Camera
    """At the size of the crop."""
    camera: Float[Array, "4 4"]
    """The same, packed."""


def read_views(source: FrameSource) -> list[View]:
    """All frames of `source`."""
    return [_read_view(source, index) for index in range(len(source))]


def _read_view(source: FrameSource, index: int) -> View:
    image, mask, camera = source.image(index), source.mask(index), source.camera(index)
    crop = body_crop(mask, _CROP_MARGIN) or (slice(0, mask.shape[0]), slice(0, mask.shape[1]))
    rgba = np.concatenate([image[crop], mask[crop][..., None]], axis=2)
    window = camera.cropped(crop[1].start, crop[0].start, rgba.shape[1], rgba.shape[0])
    pixels = np.ascontiguousarray((rgba * 255.0 + 0.5).astype(np.uint8))
    return View(pixels, window, pack_camera(window))
