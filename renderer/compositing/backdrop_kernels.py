"""The room behind the performers, and the performers laid over it: one pass over the pixels.

A floor at y = 0 with a metre grid that fades into the horizon, a sky gradient, and soft contact
shadows. The plain twin is `renderer/reference/backdrop.py`; both follow the same formulas.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.exp_kernels import exp_falling
from scene.arrays import Array

FADE_M = 14.0
"""Distance over which the floor fades into the horizon, m."""
LINE_HALF_WIDTH_M = 0.008
"""Half the width of a grid line, m."""
LINE_DARKNESS = 0.16
"""How much darker a grid line is than the floor."""
BLOCK = 16
"""Pixels a side of the squares that are drawn or left alone."""
_F = np.float32
_U = np.uint64
"""An index that can't be negative: loads and stores stay in vectors."""
_FARTHEST_M = 1e5
"""Of a floor point: near the horizon all is fog, and float32 tells metres apart no more."""
_WIDEST_SPREAD = 12.0
"""Squared distance over squared radius at which a shadow has vanished."""


@numba.njit(inline="always", fastmath=True)
def _line_coverage(x, footprint):
    """Share of a pixel `footprint` metres wide that the nearest metre line covers."""
    nearest = np.int32(x + (_F(0.5) if x > _F(0.0) else _F(-0.5)))
    away = abs(x - _F(nearest))
    edge = (_F(LINE_HALF_WIDTH_M) - away) / footprint + _F(0.5)
    thin = min(_F(1.0), _F(2.0 * LINE_HALF_WIDTH_M) / footprint)
    return min(max(edge, _F(0.0)), _F(1.0)) * thin


@numba.njit(inline="always", fastmath=True)
def _hit(turn, eye, inverse_f, first, y_plane, ground, tint):
    """Where the rays of 16 pixels meet the floor, and what mixes there.

    Fills `ground` [2 16] (x, z; m) and `tint` [4 16]: light of the floor, its share in the fog, the
    share of the zenith in the sky, 1 where it is sky.
    """
    under = eye[1] > _F(0.0)
    for x in range(BLOCK):
        x_plane = (first + _F(x)) * inverse_f[0]
        dx = turn[0, 0] * x_plane + turn[1, 0] * y_plane + turn[2, 0]
        dy = turn[0, 1] * x_plane + turn[1, 1] * y_plane + turn[2, 1]
        dz = turn[0, 2] * x_plane + turn[1, 2] * y_plane + turn[2, 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        reach = eye[1] / max(-dy, _F(1e-6))
        far = min(reach * length, _F(_FARTHEST_M))
        reach = far / length
        gx, gz = eye[0] + reach * dx, eye[2] + reach * dz
        # the footprint grows as the ray grazes the floor
        graze = max(-dy / length, _F(0.05))
        footprint = max(far, _F(0.0)) * inverse_f[1] / graze + _F(1e-6)
        cover = max(_line_coverage(gx, footprint), _line_coverage(gz, footprint))
        ground[0, _U(x)], ground[1, _U(x)] = gx, gz
        tint[0, _U(x)] = _F(1.0) - _F(LINE_DARKNESS) * cover
        tint[1, _U(x)] = exp_falling(min(far * _F(-1.0 / FADE_M), _F(0.0)))
        tint[2, _U(x)] = math.sqrt(max(dy / length, _F(0.0)))
        tint[3, _U(x)] = _F(0.0) if under and dy < _F(-1e-6) else _F(1.0)


@numba.njit(inline="always", fastmath=True)
def _shade(shadows, ground, tint):
    """Darken the floor's light by every shadow that reaches one of 16 pixels."""
    low_x, high_x = ground[0].min(), ground[0].max()
    low_z, high_z = ground[1].min(), ground[1].max()
    for s in range(shadows.shape[0]):
        x, z, strength = shadows[s, 0], shadows[s, 1], shadows[s, 3]
        away_x = max(max(low_x - x, x - high_x), _F(0.0))
        away_z = max(max(low_z - z, z - high_z), _F(0.0))
        narrow = _F(1.0) / (shadows[s, 2] * shadows[s, 2])
        if (away_x * away_x + away_z * away_z) * narrow > _F(_WIDEST_SPREAD):
            continue
        for p in range(BLOCK):
            dx, dz = ground[0, _U(p)] - x, ground[1, _U(p)] - z
            fall = exp_falling(max(-(dx * dx + dz * dz) * narrow, _F(-80.0)))
            tint[0, _U(p)] *= _F(1.0) - strength * fall


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def compose(
    out: Array,  # [H W 3] uint8, written
    rgba: Array,  # [H W 4] float32, premultiplied
    intrinsics: Array,  # [3 3] px
    rotation: Array,  # [3 3] world -> camera
    eye: Array,  # [3] m
    colours: Array,  # [3 3] float32: horizon, zenith, floor
    shadows: Array,  # [S 4] float32: x, z, radius (m), strength
    drawn: Array,  # [H/16 W/16, rounded up] bool: the blocks to write; others stay as they are
) -> None:
    """Write sRGB bytes of `rgba` over the room seen by the camera."""
    height, width = out.shape[0], out.shape[1]
    turn, at = rotation.astype(np.float32), eye.astype(np.float32)
    inverse_f = np.array([1.0 / intrinsics[0, 0], 1.0 / intrinsics[1, 1]], np.float32)
    cx, cy = _F(intrinsics[0, 2]), _F(intrinsics[1, 2])
    for row in numba.prange(height):
        ground, tint = np.empty((2, BLOCK), np.float32), np.empty((4, BLOCK), np.float32)
        y_plane = (_F(row) + _F(0.5) - cy) * inverse_f[1]
        for block in range(drawn.shape[1]):
            if not drawn[row // BLOCK, block]:
                continue
            left = block * BLOCK
            _hit(turn, at, inverse_f, _F(left) + _F(0.5) - cx, y_plane, ground, tint)
            _shade(shadows, ground, tint)
            for x in range(min(BLOCK, width - left)):
                through = _F(1.0) - rgba[row, left + x, 3]
                light, fog = tint[0, x], tint[1, x]
                rise, sky = tint[2, x], tint[3, x]
                for k in range(3):
                    horizon = colours[0, k]
                    floor = horizon + (colours[2, k] * light - horizon) * fog
                    above = horizon + (colours[1, k] - horizon) * rise
                    shown = rgba[row, left + x, k] + through * (floor + (above - floor) * sky)
                    shown = min(max(shown, _F(0.0)), _F(1.0))
                    out[row, left + x, k] = np.uint8(shown * _F(255.0) + _F(0.5))
