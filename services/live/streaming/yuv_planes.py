"""The planes of a YUV video frame, as writable arrays."""

from __future__ import annotations

from typing import cast

import numpy as np
from av.video.plane import VideoPlane

from scene.arrays import Array, UInt8


def plane_rows(plane: VideoPlane) -> UInt8[Array, "H S"]:
    """The plane's own bytes; rows may be longer than the picture is wide."""
    memory = cast(memoryview, plane)  # PyAV's types do not say that planes are buffers
    return np.frombuffer(memory, np.uint8).reshape(plane.height, plane.line_size)
