"""The room behind the performers, and the performers laid over it: one pass over the pixels.

A floor at y = 0 with a metre grid that fades into the horizon, a sky gradient, and soft contact
shadows. The plain twin is `renderer/reference/backdrop.py`; both follow the same formulas.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array

FADE_M = 14.0
"""Distance over which the floor fades into the horizon, m."""
LINE_HALF_WIDTH_M = 0.008
"""Half the width of a grid line, m."""
LINE_DARKNESS = 0.16
"""How much darker a grid line is than the floor."""


@numba.njit(inline="always", fastmath=True)
def _line_coverage(x: float, footprint: float) -> float:
    """Share of a pixel `footprint` metres wide that the nearest metre line covers."""
    away = abs(x - math.floor(x + 0.5))
    edge = (LINE_HALF_WIDTH_M - away) / footprint + 0.5
    return min(max(edge, 0.0), 1.0) * min(1.0, 2.0 * LINE_HALF_WIDTH_M / footprint)


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def compose(
    out: Array,  # [H W 3] uint8, written
    rgba: Array,  # [H W 4] float32, premultiplied
    intrinsics: Array,  # [3 3] px
    rotation: Array,  # [3 3] world -> camera
    eye: Array,  # [3] m
    colours: Array,  # [3 3] float32: horizon, zenith, floor
    shadows: Array,  # [S 4] float32: x, z, radius (m), strength
) -> None:
    """Write sRGB bytes of `rgba` over the room seen by the camera."""
    height, width = out.shape[0], out.shape[1]
    fx, fy = intrinsics[0, 0], intrinsics[1, 1]
    cx, cy = intrinsics[0, 2], intrinsics[1, 2]
    for row in numba.prange(height):
        y_plane = (row + 0.5 - cy) / fy
        for column in range(width):
            alpha = rgba[row, column, 3]
            r, g, b = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            if alpha < 0.999:
                x_plane = (column + 0.5 - cx) / fx
                dx = rotation[0, 0] * x_plane + rotation[1, 0] * y_plane + rotation[2, 0]
                dy = rotation[0, 1] * x_plane + rotation[1, 1] * y_plane + rotation[2, 1]
                dz = rotation[0, 2] * x_plane + rotation[1, 2] * y_plane + rotation[2, 2]
                norm = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
                if dy < -1e-6 and eye[1] > 0.0:
                    reach = -eye[1] / dy
                    x, z = eye[0] + reach * dx, eye[2] + reach * dz
                    far = reach / norm
                    # the footprint grows as the ray grazes the floor
                    footprint = far / fy / max(-dy * norm, 0.05) + 1e-6
                    cover = max(_line_coverage(x, footprint), _line_coverage(z, footprint))
                    light = 1.0 - LINE_DARKNESS * cover
                    for s in range(shadows.shape[0]):
                        away_x, away_z = x - shadows[s, 0], z - shadows[s, 1]
                        spread = (away_x * away_x + away_z * away_z) / (shadows[s, 2] ** 2)
                        if spread < 12.0:
                            light *= 1.0 - shadows[s, 3] * math.exp(-spread)
                    fade = math.exp(-far / FADE_M)
                    r = colours[0, 0] + (colours[2, 0] * light - colours[0, 0]) * fade
                    g = colours[0, 1] + (colours[2, 1] * light - colours[0, 1]) * fade
                    b = colours[0, 2] + (colours[2, 2] * light - colours[0, 2]) * fade
                else:
                    rise = math.sqrt(max(dy * norm, 0.0))
                    r = colours[0, 0] + (colours[1, 0] - colours[0, 0]) * rise
                    g = colours[0, 1] + (colours[1, 1] - colours[0, 1]) * rise
                    b = colours[0, 2] + (colours[1, 2] - colours[0, 2]) * rise
            through = 1.0 - alpha
            red = rgba[row, column, 0] + through * r
            green = rgba[row, column, 1] + through * g
            blue = rgba[row, column, 2] + through * b
            out[row, column, 0] = np.uint8(min(max(red, 0.0), 1.0) * 255.0 + 0.5)
            out[row, column, 1] = np.uint8(min(max(green, 0.0), 1.0) * 255.0 + 0.5)
            out[row, column, 2] = np.uint8(min(max(blue, 0.0), 1.0) * 255.0 + 0.5)
