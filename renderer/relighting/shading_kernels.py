"""Light on every splat of a picture: skinned normals, harmonics and the key light.

The plain twin is `renderer/reference/shading.py`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import COLOUR, HIDDEN_LOGIT, NO_LIGHT, OPACITY, POSITION
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
    light_index: Array,  # [N] uint8: index of each splat's light; NO_LIGHT keeps its colour
    harmonics: Array,  # [M 9 3] float32, of each light
    world_to_clip: Array,  # [M 3 3] float32: rotations from the world to each light's clip
    key_direction: Array,  # [3] float32, unit
    key_colour: Array,  # [3] float32
    encoded: Array,  # [S + 1] float32: sRGB by the root of linear light
    parameters: Array,  # [N P] float32; its colours are written
) -> None:
    """Fill the colour columns of `parameters`."""
    steps = encoded.shape[0] - 1
    for i in numba.prange(albedo.shape[0]):
        if light_index[i] == NO_LIGHT or parameters[i, OPACITY] <= _F(HIDDEN_LOGIT):
            continue
        light, rotation = harmonics[light_index[i]], world_to_clip[light_index[i]]
        x, y, z = _F(0.0), _F(0.0), _F(0.0)
        vx, vy, vz = eye[0], eye[1], eye[2]
        a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
        px, py = parameters[i, POSITION], parameters[i, POSITION + 1]
        pz = parameters[i, POSITION + 2]
        for k in range(4):
            share, transform = weights[i, k], transforms[joints[i, k]]
            if share == _F(0.0):
                continue
            x += share * (transform[0, 0] * a + transform[0, 1] * b + transform[0, 2] * c)
            y += share * (transform[1, 0] * a + transform[1, 1] * b + transform[1, 2] * c)
            z += share * (transform[2, 0] * a + transform[2, 1] * b + transform[2, 2] * c)
            vx -= share * (
                transform[0, 0] * px + transform[0, 1] * py + transform[0, 2] * pz + transform[0, 3]
            )
            vy -= share * (
                transform[1, 0] * px + transform[1, 1] * py + transform[1, 2] * pz + transform[1, 3]
            )
            vz -= share * (
                transform[2, 0] * px + transform[2, 1] * py + transform[2, 2] * pz + transform[2, 3]
            )
        length = _F(1.0) / math.sqrt(max(x * x + y * y + z * z, _F(1e-12)))
        x, y, z = x * length, y * length, z * length
        # splats seen through from the far side take the normal mirrored to the viewer
        view_cosine = x * vx + y * vy + z * vz
        if view_cosine < _F(0.0):
            twice = _F(2.0) * view_cosine / max(vx * vx + vy * vy + vz * vz, _F(1e-12))
            x, y, z = x - twice * vx, y - twice * vy, z - twice * vz
        x, y, z = (
            rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
            rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
            rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
        )
        towards = x * key_direction[0] + y * key_direction[1] + z * key_direction[2]
        facing = max(towards, _F(0.0))
        for j in range(3):
            irradiance = (
                _F(0.282095) * light[0, j]
                + _F(0.488603) * (y * light[1, j] + z * light[2, j] + x * light[3, j])
                + _F(1.092548) * (x * y * light[4, j] + y * z * light[5, j] + x * z * light[7, j])
                + _F(0.315392) * (_F(3.0) * z * z - _F(1.0)) * light[6, j]
                + _F(0.546274) * (x * x - y * y) * light[8, j]
            )
            shown = albedo[i, j] * (max(irradiance, _F(0.0)) + facing * key_colour[j])
            position = math.sqrt(min(max(shown, _F(0.0)), _F(1.0))) * steps
            step = min(int(position), steps - 1)
            part = position - step
            parameters[i, COLOUR + j] = (_F(1.0) - part) * encoded[step] + part * encoded[step + 1]
