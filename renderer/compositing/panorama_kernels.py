"""A place behind the performers, and the performers laid over it: one pass over the pixels.

A panorama was taken from one point, C, at eye level; viewers walk about. So that its floor lies
under everybody's feet, what is below is laid on the floor y = 0 and the rest on a dome round C: a
pixel shows the panorama in the direction from C to where its ray meets them. The plain twin is
`renderer/reference/panorama.py`; both follow the same formulas.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.compositing.backdrop_kernels import BLOCK
from scene.arrays import Array

PANORAMA_HEIGHT_M = 1.6
"""Height of C above the floor, in the middle of the room."""
DOME_RADIUS_M = 8.0
"""Radius of the dome."""
_F = np.float32
_QUARTER = _F(math.pi / 2.0)


@numba.njit(inline="always", fastmath=True)
def _angle(y, x):
    """atan2 within 1e-4 rad."""
    far, near = max(abs(x), abs(y)), min(abs(x), abs(y))
    a = near / max(far, _F(1e-12))
    s = a * a
    angle = ((_F(-0.0464964749) * s + _F(0.15931422)) * s - _F(0.327622764)) * s * a + a
    if abs(y) > abs(x):
        angle = _QUARTER - angle
    if x < _F(0.0):
        angle = _F(math.pi) - angle
    return -angle if y < _F(0.0) else angle


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def compose_panorama(
    out: Array,  # [H W 3] uint8, written
    rgba: Array,  # [H W 4] float32, premultiplied
    intrinsics: Array,  # [3 3] px
    rotation: Array,  # [3 3] world -> camera
    eye: Array,  # [3] m
    picture: Array,  # [h w+1 3] float32, sRGB; the last column is the first again
    shadows: Array,  # [S 4] float32: x, z, radius (m), strength
    drawn: Array,  # [H/16 W/16, rounded up] bool: the blocks to write; others stay as they are
) -> None:
    """Write sRGB bytes of `rgba` over the place seen by the camera."""
    height, width = out.shape[0], out.shape[1]
    rows, columns = picture.shape[0], picture.shape[1] - 1
    inverse_fx, inverse_fy = _F(1.0 / intrinsics[0, 0]), _F(1.0 / intrinsics[1, 1])
    cx, cy = _F(intrinsics[0, 2]), _F(intrinsics[1, 2])
    turn = rotation.astype(np.float32)
    ex, ey, ez = _F(eye[0]), _F(eye[1]), _F(eye[2])
    up, reach = _F(PANORAMA_HEIGHT_M), _F(DOME_RADIUS_M)
    floor = reach * reach - up * up
    by_column, by_row = _F(columns / (2.0 * math.pi)), _F(rows / math.pi)
    for row in numba.prange(height):
        y_plane = (_F(row) + _F(0.5) - cy) * inverse_fy
        for column in range(width):
            if not drawn[row // BLOCK, column // BLOCK]:
                continue
            alpha = rgba[row, column, 3]
            r, g, b = _F(0.0), _F(0.0), _F(0.0)
            if alpha < _F(0.999):
                x_plane = (_F(column) + _F(0.5) - cx) * inverse_fx
                dx = turn[0, 0] * x_plane + turn[1, 0] * y_plane + turn[2, 0]
                dy = turn[0, 1] * x_plane + turn[1, 1] * y_plane + turn[2, 1]
                dz = turn[0, 2] * x_plane + turn[1, 2] * y_plane + turn[2, 2]
                x, y, z = _F(0.0), _F(-1.0), _F(0.0)
                on_floor = False
                if dy < _F(-1e-6) and ey > _F(0.0):
                    t = -ey / dy
                    x, z = ex + t * dx, ez + t * dz
                    on_floor = x * x + z * z < floor
                light = _F(1.0)
                if on_floor:
                    for s in range(shadows.shape[0]):
                        away_x, away_z = x - shadows[s, 0], z - shadows[s, 1]
                        spread = (away_x * away_x + away_z * away_z) / (
                            shadows[s, 2] * shadows[s, 2]
                        )
                        if spread < _F(12.0):
                            light *= _F(1.0) - shadows[s, 3] * math.exp(-spread)
                    y = -up
                else:
                    # |e - C + t d| = reach, the farther crossing
                    a = dx * dx + dy * dy + dz * dz
                    half = ex * dx + (ey - up) * dy + ez * dz
                    rest = ex * ex + (ey - up) * (ey - up) + ez * ez - reach * reach
                    t = (-half + math.sqrt(max(half * half - a * rest, _F(0.0)))) / a
                    x, y, z = ex + t * dx, ey - up + t * dy, ez + t * dz
                u = _angle(z, x) * by_column + _F(0.5) * columns - _F(0.5)
                v = _F(0.5) * rows - _F(0.5) - _angle(y, math.sqrt(x * x + z * z)) * by_row
                u = u + columns if u < _F(0.0) else u
                v = min(max(v, _F(0.0)), _F(rows) - _F(1.001))
                left, top = min(int(u), columns - 1), int(v)
                across, down = u - left, v - top
                w00, w01 = (_F(1.0) - down) * (_F(1.0) - across), (_F(1.0) - down) * across
                w10, w11 = down * (_F(1.0) - across), down * across
                upper, lower = picture[top], picture[top + 1]
                r = light * (
                    w00 * upper[left, 0]
                    + w01 * upper[left + 1, 0]
                    + w10 * lower[left, 0]
                    + w11 * lower[left + 1, 0]
                )
                g = light * (
                    w00 * upper[left, 1]
                    + w01 * upper[left + 1, 1]
                    + w10 * lower[left, 1]
                    + w11 * lower[left + 1, 1]
                )
                b = light * (
                    w00 * upper[left, 2]
                    + w01 * upper[left + 1, 2]
                    + w10 * lower[left, 2]
                    + w11 * lower[left + 1, 2]
                )
            through = _F(1.0) - alpha
            red = min(max(rgba[row, column, 0] + through * r, _F(0.0)), _F(1.0))
            green = min(max(rgba[row, column, 1] + through * g, _F(0.0)), _F(1.0))
            blue = min(max(rgba[row, column, 2] + through * b, _F(0.0)), _F(1.0))
            out[row, column, 0] = np.uint8(red * _F(255.0) + _F(0.5))
            out[row, column, 1] = np.uint8(green * _F(255.0) + _F(0.5))
            out[row, column, 2] = np.uint8(blue * _F(255.0) + _F(0.5))
