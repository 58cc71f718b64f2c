"""Reads panoramas: Radiance .hdr (linear radiance), or a picture of what one looks like."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from capture.errors import CaptureError
from scene.arrays import Array, Float
from scene.lighting import require_panorama

_LARGEST_PX = 8192


def read_panorama(path: Path) -> Float[Array, "H W 3"]:
    """Linear RGB radiance of an equirectangular Radiance .hdr.

    Raises CaptureError for a file that is none, InvalidInput for one that isn't twice as wide as
    high.
    """
    if path.suffix.lower() != ".hdr":
        raise CaptureError(f"panorama must be a Radiance .hdr file; got {path.name}")
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.exists() else None
    if picture is None or picture.dtype != np.float32 or picture.ndim != 3:
        raise CaptureError(f"panorama must be a readable Radiance .hdr file; got {path}")
    if max(picture.shape) > _LARGEST_PX:
        size = f"{picture.shape[1]} x {picture.shape[0]}"
        raise CaptureError(f"panorama must be at most {_LARGEST_PX} px wide; got {size}; shrink it")
    panorama = np.ascontiguousarray(picture[..., ::-1]).astype(np.float64)
    require_panorama(panorama)
    return panorama
