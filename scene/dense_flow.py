"""Optical flow of pictures of any size: dense inverse search (Kroeger et al. 2016), by OpenCV."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scene.arrays import Array, Float, UInt8

if TYPE_CHECKING:
    import cv2

_LEAST_PX = 32
"""Sides of the smallest picture on which OpenCV's search is safe, with each of its presets. For
smaller ones it chooses the levels of its pyramid by the width alone, and reads beyond a level that
is lower than a patch."""


def dense_flow(
    search: cv2.DISOpticalFlow,
    first: UInt8[Array, "H W"],
    second: UInt8[Array, "H W"],
    begun: Float[Array, "H W 2"],
) -> Float[Array, "H W 2"]:
    """From what `first` shows to where `second` shows it, px right and down; float32.

    Args:
        begun: where the search begins; may be overwritten.
    """
    import cv2

    height, width = first.shape
    below, beside = max(_LEAST_PX - height, 0), max(_LEAST_PX - width, 0)
    if below or beside:
        first, second, begun = (
            cv2.copyMakeBorder(of, 0, below, 0, beside, cv2.BORDER_REPLICATE)
            for of in (first, second, begun)
        )
    finest = search.getFinestScale()
    flow = search.calc(first, second, begun)[:height, :width]
    search.setFinestScale(finest)  # which a small picture changes for all that come later
    return flow
