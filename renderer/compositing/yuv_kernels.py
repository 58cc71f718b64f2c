"""sRGB bytes to what a video encoder takes: planes of luma and of chroma at half size, one pass.

ITU-R BT.601, limited range: Y = 16 + 65.5 R + 128.6 G + 25.0 B with R, G, B in [0, 1] (rounded to
1/256 here), chroma of the mean of 2 x 2 pixels. Browsers take VP8 for just this.
"""

from __future__ import annotations

import numba
import numpy as np

from renderer.compositing.backdrop_kernels import BLOCK
from scene.arrays import Array


@numba.njit(parallel=True, nogil=True, cache=True)
def to_yuv420(
    rgb: Array,  # [H W 3] uint8, H and W even
    changed: Array,  # [H/16 W/16, rounded up] bool: the blocks to write; others stay as they are
    luma: Array,  # [H >=W] uint8, written: rows may be longer than the picture
    blue: Array,  # [H/2 >=W/2] uint8, written
    red: Array,  # [H/2 >=W/2] uint8, written
) -> None:
    """Fill the planes of a yuv420p frame."""
    halves = BLOCK // 2
    for pair in numba.prange(rgb.shape[0] // 2):
        for block in range(changed.shape[1]):
            if not changed[pair // halves, block]:
                continue
            for half in range(block * halves, min((block + 1) * halves, rgb.shape[1] // 2)):
                r, g, b = np.int32(0), np.int32(0), np.int32(0)
                for below in range(2):
                    line = rgb[2 * pair + below]
                    for beside in range(2):
                        x = 2 * half + beside
                        one, two, three = (
                            np.int32(line[x, 0]),
                            np.int32(line[x, 1]),
                            np.int32(line[x, 2]),
                        )
                        shade = 66 * one + 129 * two + 25 * three + 128
                        luma[2 * pair + below, x] = np.uint8((shade >> 8) + 16)
                        r, g, b = r + one, g + two, b + three
                # sums of four pixels: 4 * 256 = 1 << 10
                blue[pair, half] = np.uint8(((-38 * r - 74 * g + 112 * b + 512) >> 10) + 128)
                red[pair, half] = np.uint8(((112 * r - 94 * g - 18 * b + 512) >> 10) + 128)
