"""Live changes spread over the surface, from splats that pixels show well to those beside them."""

from __future__ import annotations

import numba
import numpy as np

from scene.arrays import Array

_F = np.float32
_LITTLE = 0.5
"""Weight of no change beside the neighbours' shares: far from what is seen, nothing is spread."""


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def spread(
    change: Array,  # [N 3] float32
    share: Array,  # [N] float32, 0 to 1: how well each splat's own change is known
    otherwise: Array,  # [N 3] float32: the change of what nothing is known of
    near: Array,  # [N M] int32: each splat's neighbours, and itself
    shown: Array,  # [N 3] float32, written
) -> None:
    """Each splat's own change as far as it is known, else its neighbours' by their shares."""
    count, many = near.shape
    for i in numba.prange(count):
        own = share[i]
        red, green, blue, known = _F(0.0), _F(0.0), _F(0.0), _F(0.0)
        if own < _F(1.0):
            for m in range(many):
                j = near[i, m]
                weight = share[j]
                known += weight
                red += weight * change[j, 0]
                green += weight * change[j, 1]
                blue += weight * change[j, 2]
        scale = (_F(1.0) - own) / (known + _F(_LITTLE))
        rest = scale * _F(_LITTLE)
        shown[i, 0] = own * change[i, 0] + scale * red + rest * otherwise[i, 0]
        shown[i, 1] = own * change[i, 1] + scale * green + rest * otherwise[i, 1]
        shown[i, 2] = own * change[i, 2] + scale * blue + rest * otherwise[i, 2]
