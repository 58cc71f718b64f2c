"""Which triangle is in front at every sample, and where in it: one depth test a sample."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

F64, I64 = NDArray[np.float64], NDArray[np.int64]


@njit(cache=True, boundscheck=False)
def nearest_triangles(
    points: F64, depths: F64, faces: I64, width: int, height: int
) -> tuple[Any, Any]:
    """Triangle [H, W] (-1: none) and its corners' shares in the surface point [H, W, 3].

    `points` [V, 2] are in samples, whose centres are at halves; `depths` [V] along the view. Shares
    are those in space, not on the screen.
    """
    front = np.full((height, width), np.inf)
    found = np.full((height, width), -1, np.int32)
    shares = np.zeros((height, width, 3), np.float32)
    for t in range(len(faces)):
        a, b, c = faces[t]
        ax, ay = points[a]
        bx, by = points[b]
        cx, cy = points[c]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0 or min(depths[a], depths[b], depths[c]) <= 0.01:
            continue
        left = max(0, int(np.ceil(min(ax, bx, cx) - 0.5)))
        right = min(width - 1, int(np.floor(max(ax, bx, cx) - 0.5)))
        top = max(0, int(np.ceil(min(ay, by, cy) - 0.5)))
        bottom = min(height - 1, int(np.floor(max(ay, by, cy) - 0.5)))
        for y in range(top, bottom + 1):
            py = y + 0.5
            for x in range(left, right + 1):
                px = x + 0.5
                wa = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
                wb = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
                wc = 1.0 - wa - wb
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                ia, ib, ic = wa / depths[a], wb / depths[b], wc / depths[c]
                depth = 1.0 / (ia + ib + ic)
                if depth < front[y, x]:
                    front[y, x] = depth
                    found[y, x] = t
                    shares[y, x, 0] = ia * depth
                    shares[y, x, 1] = ib * depth
                    shares[y, x, 2] = ic * depth
    return found, shares
