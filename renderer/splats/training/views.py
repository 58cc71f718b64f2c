"""The training frames as the kernels take them: cropped to the body, 8 bits, cameras packed."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from renderer.splats.rasteriser.workspace import pack_camera
from scene.arrays import Array, Bool, Float, UInt8
from scene.camera import Camera
from scene.sequence import Crop, CropSource, FrameSource, crop_window

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

    @classmethod
    def of(cls, rgba: UInt8[Array, "H W 4"], window: Camera) -> View:
        """What `window` saw."""
        return cls(rgba, window, pack_camera(window))

    def pixels_at(
        self, places: Float[Array, "*batch 3"]
    ) -> tuple[UInt8[Array, "*batch 4"], Bool[Array, "*batch"], Bool[Array, "*batch"]]:
        """The pixels that show `places` (m, in the world); whether the picture holds them, else
        they are any pixels; and which lie below it."""
        projected, _ = self.window.project(places)
        height, width = self.rgba.shape[:2]
        x, y = np.floor(projected).astype(int).transpose(-1, *range(projected.ndim - 1))
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        pixels = self.rgba[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        return pixels, inside, y >= height

    def resized(self, scale: float) -> View:
        """`scale` times as large, box-filtered; itself at 1."""
        if scale == 1.0:
            return self
        import cv2

        height, width = (max(1, round(scale * side)) for side in self.rgba.shape[:2])
        rgba = cv2.resize(self.rgba, (width, height), interpolation=cv2.INTER_AREA)
        return View.of(rgba, self.window.resized(width, height))

    def cut(self, x: int, y: int, side: int) -> View:
        """The square of `side` px about the pixel (x, y), moved to lie inside the picture."""
        height, width = self.rgba.shape[:2]
        left = min(max(x - side // 2, 0), max(width - side, 0))
        top = min(max(y - side // 2, 0), max(height - side, 0))
        rgba = np.ascontiguousarray(self.rgba[top : top + side, left : left + side])
        return View.of(rgba, self.window.cropped(left, top, rgba.shape[1], rgba.shape[0]))


def read_views(source: FrameSource) -> list[View]:
    """All frames of `source`; those on disk are decoded on as many threads as there are cores.

    What a frame raises is raised, with a note that tells which frame it was.
    """
    read = partial(_read_view, source)
    if not isinstance(source, CropSource):
        return [read(index) for index in range(len(source))]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0)), "read_views") as pool:
        return list(pool.map(read, range(len(source))))


def _read_view(source: FrameSource, index: int) -> View:
    try:
        crop = (
            source.crop(index, _CROP_MARGIN)
            if isinstance(source, CropSource)
            else _cut(source.image(index), source.mask(index))
        )
    except Exception as error:
        error.add_note(f"in training frame {index}")
        raise
    height, width = crop.rgba.shape[:2]
    window = source.camera(index).cropped(crop.columns.start, crop.rows.start, width, height)
    return View.of(crop.rgba, window)


def _cut(image: Float[Array, "H W 3"], mask: Float[Array, "H W"]) -> Crop:
    rows, columns = crop_window(mask, _CROP_MARGIN)
    rgba = np.concatenate([image[rows, columns], mask[rows, columns][..., None]], axis=2)
    return Crop(np.ascontiguousarray((rgba * 255.0 + 0.5).astype(np.uint8)), rows, columns)
