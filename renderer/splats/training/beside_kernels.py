"""Carries a frame's pixels over to a camera beside it, by the surface that both see."""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import POSITION, UNKNOWN
from scene.arrays import Array

_F = np.float32
_STEEP = 0.15
"""Cosine between ray and normal below which the ray meets a splat's plane too far away."""
_THICK_M = 0.02
"""How far a splat's plane may lie before or behind its centre, and one surface's depths apart."""
_FACING = 0.35
"""Cosine between surface and view below which a frame's pixels tell little of the surface."""
_OPAQUE = 250
"""Alpha of 255 from which a pixel shows the person alone."""


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def pose_surface(
    parameters: Array,  # [N P] float32
    normals: Array,  # [N 3] float32
    joints: Array,  # [N 4] uint16
    weights: Array,  # [N 4] float32
    transforms: Array,  # [K 4 4] float32, rest -> world
    places: Array,  # [N 3] float32, written, m
    turned: Array,  # [N 3] float32, written: normals
) -> None:
    """Skin the splats' places and the surface's normals."""
    for i in numba.prange(parameters.shape[0]):
        for r in range(3):
            place, normal = _F(0.0), _F(0.0)
            for s in range(4):
                weight, row = weights[i, s], transforms[joints[i, s], r]
                along, across = row[3], _F(0.0)
                for c in range(3):
                    along += row[c] * parameters[i, POSITION + c]
                    across += row[c] * normals[i, c]
                place += weight * along
                normal += weight * across
            places[i, r], turned[i, r] = place, normal


@numba.njit(inline="always", fastmath=True)
def _ray(camera, x, y, ray):
    """Direction of the pixel's ray in the world, of depth 1."""
    a = (_F(x) + _F(0.5) - camera[3, 2]) / camera[3, 0]
    b = (_F(y) + _F(0.5) - camera[3, 3]) / camera[3, 1]
    for c in range(3):
        ray[c] = a * camera[0, c] + b * camera[1, c] + camera[2, c]


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def fill_depths(
    front: Array,  # [H W] int32: splat of each pixel, -1 where none
    places: Array,  # [N 3] float32
    normals: Array,  # [N 3] float32
    camera: Array,  # [4 4] float32: rows R|t, then fx fy cx cy
    depths: Array,  # [H W] float32, written: m, 0 where none
) -> None:
    """Where each pixel's ray meets the plane of its splat."""
    for y in numba.prange(front.shape[0]):
        ray = np.empty(3, np.float32)
        for x in range(front.shape[1]):
            i = front[y, x]
            if i < 0:
                depths[y, x] = 0.0
                continue
            _ray(camera, x, y, ray)
            slope, away, length = _F(0.0), _F(0.0), _F(0.0)
            depth = camera[2, 3]
            for c in range(3):
                eye = _eye(camera, c)
                slope += normals[i, c] * ray[c]
                away += normals[i, c] * (places[i, c] - eye)
                length += ray[c] * ray[c]
                depth += camera[2, c] * places[i, c]
            depths[y, x] = depth
            if abs(slope) > _F(_STEEP) * math.sqrt(length):
                met = away / slope
                if abs(met - depth) < _F(_THICK_M):
                    depths[y, x] = met


@numba.njit(inline="always", fastmath=True)
def _eye(camera, c):
    return -(
        camera[0, c] * camera[0, 3] + camera[1, c] * camera[1, 3] + camera[2, c] * camera[2, 3]
    )


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def carry_over(
    source: Array,  # [h w 4] uint8, premultiplied, filmed by a camera like `frame_camera`
    frame_depths: Array,  # [H' W'] float32
    frame_camera: Array,  # [4 4] float32
    front: Array,  # [H W] int32
    depths: Array,  # [H W] float32
    normals: Array,  # [N 3] float32
    told: Array,  # [N] bool: splats whose pixels are carried over
    camera: Array,  # [4 4] float32
    target: Array,  # [H W 4] uint8, written: nil where no surface is
) -> None:
    """What `camera` sees of the surface, in the colours that the frame shows there; `UNKNOWN`
    where the frame does not show it, hidden or turned away."""
    height, width = frame_depths.shape
    scale_x, scale_y = _F(source.shape[1]) / _F(width), _F(source.shape[0]) / _F(height)
    for y in numba.prange(front.shape[0]):
        point, local = np.empty(3, np.float32), np.empty(3, np.float32)
        for x in range(front.shape[1]):
            i = front[y, x]
            for c in range(4):
                target[y, x, c] = np.uint8(0) if i < 0 else np.uint8(UNKNOWN[c])
            if i < 0 or not told[i]:
                continue
            _ray(camera, x, y, point)
            cosine, length = _F(0.0), _F(0.0)
            for c in range(3):
                point[c] = _eye(camera, c) + depths[y, x] * point[c]
                away = _eye(frame_camera, c) - point[c]
                cosine += normals[i, c] * away
                length += away * away
            if cosine < _F(_FACING) * math.sqrt(length):
                continue
            for r in range(3):
                local[r] = frame_camera[r, 3]
                for c in range(3):
                    local[r] += frame_camera[r, c] * point[c]
            u = frame_camera[3, 0] * local[0] / local[2] + frame_camera[3, 2]
            v = frame_camera[3, 1] * local[1] / local[2] + frame_camera[3, 3]
            if not (u >= 0.0 and v >= 0.0 and u < width and v < height):
                continue
            if abs(frame_depths[int(v), int(u)] - local[2]) > _F(_THICK_M):
                continue
            _sample(source, u * scale_x - _F(0.5), v * scale_y - _F(0.5), target[y, x])


@numba.njit(inline="always", fastmath=True)
def _sample(source, u, v, pixel):
    """`source` at (u, v), bilinear, into `pixel`, where it shows the person alone."""
    left, top = math.floor(u), math.floor(v)
    if left < 0 or top < 0 or left + 1 >= source.shape[1] or top + 1 >= source.shape[0]:
        return
    for row in range(2):
        for column in range(2):
            if source[top + row, left + column, 3] < _OPAQUE:
                return
    a, b = u - _F(left), v - _F(top)
    for c in range(4):
        upper = (_F(1.0) - a) * source[top, left, c] + a * source[top, left + 1, c]
        lower = (_F(1.0) - a) * source[top + 1, left, c] + a * source[top + 1, left + 1, c]
        pixel[c] = np.uint8((_F(1.0) - b) * upper + b * lower + _F(0.5))
