"""Light on every splat of a picture: normals turned by the skinning, harmonics, the key light.

The plain twin is `renderer/reference/shading.py`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import COLOUR, NOBODYS, POSITION
from scene.arrays import Array

_F = np.float32


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def shade(
    albedo: Array,  # [N 3] float32, linear
    normals: Array,  # [N 3] float32, at rest
    joints: Array,  # [N 4] integers
    weights: Array,  # [N 4] float32
    transforms: Array,  # [K 4 4] float32, rest -> world
    eye: Array,  # [3] float32, m
    whose: Array,  # [N] uint8: the light that falls on each; NOBODYS leaves its colour as it is
    harmonics: Array,  # [M 9 3] float32, of each light
    homes: Array,  # [M 3 3] float32: turns from the world to where each light is known
    key_direction: Array,  # [3] float32, unit
    key_colour: Array,  # [3] float32
    encoded: Array,  # [S + 1] float32: sRGB by the root of linear light
    parameters: Array,  # [N P] float32; its colours are written
) -> None:
    """Fill the colour columns of `parameters`."""
    steps = encoded.shape[0] - 1
    for i in numba.prange(albedo.shape[0]):
        if whose[i] == NOBODYS:
            continue
        light, home = harmonics[whose[i]], homes[whose[i]]
        x, y, z = _F(0.0), _F(0.0), _F(0.0)
        vx, vy, vz = eye[0], eye[1], eye[2]
        a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
        px, py = parameters[i, POSITION], parameters[i, POSITION + 1]
        pz = parameters[i, POSITION + 2]
        for k in range(4):
            share, turn = weights[i, k], transforms[joints[i, k]]
            if share == _F(0.0):
                continue
            x += share * (turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * c)
            y += share * (turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * c)
            z += share * (turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * c)
            vx -= share * (turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz + turn[0, 3])
            vy -= share * (turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz + turn[1, 3])
            vz -= share * (turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz + turn[2, 3])
        length = _F(1.0) / math.sqrt(max(x * x + y * y + z * z, _F(1e-12)))
        x, y, z = x * length, y * length, z * length
        # what shines through from the far side stands for what lies before it
        away = x * vx + y * vy + z * vz
        if away < _F(0.0):
            twice = _F(2.0) * away / max(vx * vx + vy * vy + vz * vz, _F(1e-12))
            x, y, z = x - twice * vx, y - twice * vy, z - twice * vz
        x, y, z = (
            home[0, 0] * x + home[0, 1] * y + home[0, 2] * z,
            home[1, 0] * x + home[1, 1] * y + home[1, 2] * z,
            home[2, 0] * x + home[2, 1] * y + home[2, 2] * z,
        )
        towards = x * key_direction[0] + y * key_direction[1] + z * key_direction[2]
        facing = max(towards, _F(0.0))
        for j in range(3):
            smooth = (
                _F(0.282095) * light[0, j]
                + _F(0.488603) * (y * light[1, j] + z * light[2, j] + x * light[3, j])
                + _F(1.092548) * (x * y * light[4, j] + y * z * light[5, j] + x * z * light[7, j])
                + _F(0.315392) * (_F(3.0) * z * z - _F(1.0)) * light[6, j]
                + _F(0.546274) * (x * x - y * y) * light[8, j]
            )
            shown = albedo[i, j] * (max(smooth, _F(0.0)) + facing * key_colour[j])
            place = math.sqrt(min(max(shown, _F(0.0)), _F(1.0))) * steps
            step = min(int(place), steps - 1)
            part = place - step
            parameters[i, COLOUR + j] = (_F(1.0) - part) * encoded[step] + part * encoded[step + 1]
