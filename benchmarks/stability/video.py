"""A clip through a codec for video: what a browser or a phone does to whatever is filmed."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

import av
import numpy as np

from scene.arrays import Array, Float, UInt8

_RATE = 30
"""Frames a second that the encoder is told of: it only shares bits out among frames."""

_REPEATABLE = {"x264-params": "cpu-independent=1"}
"""Else what is encoded differs from run to run, by where in memory its numbers lie."""


def through_h264(
    pictures: Sequence[Float[Array, "H W 3"]], bits_a_pixel: float
) -> list[Float[Array, "H W 3"]]:
    """sRGB pictures in [0, 1], all of one size, encoded by H.264 and decoded again.

    Args:
        bits_a_pixel: mean of the clip that the encoder is asked for; 30 frames a second of
            1280 x 720 px at 2 Mbit/s have 0.07.
    """
    high, wide = pictures[0].shape[:2]
    file = BytesIO()
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=_RATE, options=_REPEATABLE)
        # colours have half the picture's sides
        stream.width, stream.height, stream.pix_fmt = wide + wide % 2, high + high % 2, "yuv420p"
        stream.bit_rate = round(bits_a_pixel * wide * high * _RATE)
        stream.thread_count = 1  # what is encoded depends on their number
        for picture in pictures:
            even = np.pad(_in_bytes(picture), ((0, high % 2), (0, wide % 2), (0, 0)), mode="edge")
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
        container.mux(stream.encode())
    file.seek(0)
    with av.open(file, "r") as coded:
        decoded = [frame.to_ndarray(format="rgb24") for frame in coded.decode(video=0)]
    return [frame[:high, :wide].astype(np.float32) / np.float32(255.0) for frame in decoded]


def _in_bytes(picture: Float[Array, "H W 3"]) -> UInt8[Array, "H W 3"]:
    return (255.0 * np.clip(picture, 0.0, 1.0) + 0.5).astype(np.uint8)
