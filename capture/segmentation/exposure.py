"""Exposure and white balance that a camera changes while it films, by what stands still before it.

A gain a channel and frame, as pixels are stored: a camera scales light, and sRGB's curve is near
enough to a power, under which a factor stays a factor. What each frame shows beside the person is
compared with what the clip usually shows there: the median of the ratios is the gain, and their
spread tells whether it can be believed.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from capture.detection.landmarks import Landmarks
from capture.segmentation.masks import dilated_person_mask
from scene.arrays import Array, Bool, Float, UInt8

_SIDE_PX = 96
"""Of the pictures that are compared, at most."""
_DARK, _BRIGHT = 16.0, 240.0
"""A pixel beyond these may be clipped, and its ratio says less than the gain."""
_MAX_SPREAD = 0.04
"""Median absolute deviation of the ratios' logarithms above which a frame shows something else
than the clip: the camera was moved, or a lamp lit a part of the room."""
_MIN_PIXELS = 0.05
"""Share of the picture that must show the room, neither dark nor bright."""
_LEAST_CHANGE = 0.02
"""Of a channel over the clip, largest to smallest gain: less is noise, and stays as filmed."""
_ROUNDS = 3
"""The first median is of pictures of unlike exposure; those after, of evened ones."""


def find_gains(
    images: Sequence[UInt8[Array, "H W 3"]], people: Sequence[Landmarks | None]
) -> Float[Array, "F 3"]:
    """What each frame's channels are times those of the clip's usual picture.

    Ones where they hardly change, and where half of the frames or more can't be compared, as those
    of a camera that moves. A frame that can't, or in which the person is lost (None of `people`),
    has the gains of its neighbours in time.
    """
    looks = [_room(*pair) for pair in zip(images, people, strict=True)]
    room = np.ma.stack(looks)
    shown = ~np.ma.getmaskarray(room)[..., 0]
    gains, spread = np.zeros((len(images), 3)), np.full((len(images), 3), np.inf)
    for _ in range(_ROUNDS):
        usual = np.ma.median(room - gains[:, None], axis=0)
        for number, seen in enumerate(shown):
            ratios = (room[number, seen] - usual[seen]).compressed().reshape(-1, 3)
            if len(ratios) >= _MIN_PIXELS * len(seen):
                gains[number] = np.median(ratios, axis=0)
                spread[number] = np.median(np.abs(ratios - gains[number]), axis=0)
    believed = spread.max(axis=1) < _MAX_SPREAD
    if believed.mean() <= 0.5:
        return np.ones_like(gains)
    gains = _from_neighbours(gains, believed)
    changed = np.ptp(gains, axis=0) > np.log1p(_LEAST_CHANGE)
    return np.exp(gains) if changed.any() else np.ones_like(gains)


def evened(
    images: Sequence[UInt8[Array, "H W 3"]], gains: Float[Array, "F 3"]
) -> tuple[UInt8[Array, "H W 3"], ...]:
    """`images` as if their camera had kept its exposure: without their `gains` (`find_gains`)."""
    levels = np.arange(256.0)[:, None]
    return tuple(
        image if (gain == 1.0).all() else _by_table(image, levels / gain)
        for image, gain in zip(images, gains, strict=True)
    )


def _room(image: UInt8[Array, "H W 3"], person: Landmarks | None) -> np.ma.MaskedArray:
    """Logarithms of a small copy, one row a pixel; masked where they say nothing of the room."""
    height, width = image.shape[:2]
    scale = min(1.0, _SIDE_PX / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).reshape(-1, 3).astype(float)
    hidden = (small.min(axis=1) <= _DARK) | (small.max(axis=1) >= _BRIGHT)
    if person is None:
        hidden[:] = True
    else:
        covered = cv2.resize(255 * dilated_person_mask(person), size, interpolation=cv2.INTER_AREA)
        hidden |= covered.reshape(-1) > 0
    return np.ma.masked_array(np.log(np.maximum(small, 1.0)), np.repeat(hidden[:, None], 3, axis=1))


def _from_neighbours(gains: Float[Array, "F 3"], believed: Bool[Array, "F"]) -> Float[Array, "F 3"]:
    """Gains, between those that are believed where one is not."""
    frames = np.arange(len(gains))
    return np.stack(
        [np.interp(frames, frames[believed], channel[believed]) for channel in gains.T], axis=1
    )


def _by_table(image: UInt8[Array, "H W 3"], values: Float[Array, "256 3"]) -> UInt8[Array, "H W 3"]:
    table = np.clip(np.rint(values), 0, 255).astype(np.uint8)
    return cv2.LUT(image, table[None])
