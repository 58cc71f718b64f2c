"""A picture's detail on a view, pixel by pixel."""

from __future__ import annotations

import numba
import numpy as np

from scene.arrays import Array

_F = np.float32
WHOLE = 0.7
"""Share of a pixel that must be seen by the webcam for all of its detail: what shines through from
behind is not."""


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def lay(
    view: Array,  # [H W 4] float32, changed: premultiplied sRGB and alpha
    blended: Array,  # [H W 4] float32: `values_to_blend`, blended as colours are
    detail: Array,  # [h w 3] float32
    scale: float,  # px of the picture for one of the view
    strength: float,
) -> None:
    """Multiply `view` by the detail of the place that each pixel has in the picture."""
    rows, columns = detail.shape[0], detail.shape[1]
    step, most = _F(scale), _F(strength)
    for y in numba.prange(view.shape[0]):
        for x in range(view.shape[1]):
            seen, alpha = blended[y, x, 2], view[y, x, 3]
            if seen < _F(1.0 / 256.0):
                continue
            share = most * min(seen / (_F(WHOLE) * alpha), _F(1.0))
            # pixels' centres are at halves
            across = blended[y, x, 0] / seen + step * (_F(x) + _F(0.5)) - _F(0.5)
            down = blended[y, x, 1] / seen + step * (_F(y) + _F(0.5)) - _F(0.5)
            across = min(max(across, _F(0.0)), _F(columns - 1))
            down = min(max(down, _F(0.0)), _F(rows - 1))
            left, top = int(across), int(down)
            right, bottom = min(left + 1, columns - 1), min(top + 1, rows - 1)
            fx, fy = across - _F(left), down - _F(top)
            for c in range(3):
                upper = detail[top, left, c] + fx * (detail[top, right, c] - detail[top, left, c])
                lower = detail[bottom, left, c] + fx * (
                    detail[bottom, right, c] - detail[bottom, left, c]
                )
                factor = upper + fy * (lower - upper)
                shown = view[y, x, c] * (_F(1.0) + share * (factor - _F(1.0)))
                view[y, x, c] = min(shown, alpha)
