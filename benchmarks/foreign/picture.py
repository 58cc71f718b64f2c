"""How the figure looks: its clothes, the room's light, and a camera that takes 16 samples a pixel.

The room has z up. Light is linear until a picture is coded as sRGB.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.foreign.figure import Figure
from benchmarks.foreign.raster_kernels import nearest_triangles

Array = NDArray[np.float64]

SAMPLES_A_SIDE = 4
_KEY_FROM = np.array([0.62, -0.66, 0.42]) / np.linalg.norm([0.62, -0.66, 0.42])
"""Direction to the key light, in the room."""
_KEY, _SKY, _GROUND = 0.56, 0.56, 0.40
"""Irradiance over pi of the key light head on, from above and from below."""
_WALL = (112, 118, 124)
"""The room behind the person, sRGB in 8 bits."""

_SKIN, _HAIR, _LIP = (0.62, 0.38, 0.27), (0.045, 0.028, 0.02), (0.45, 0.13, 0.11)
_WHITE, _RED, _NAVY = (0.80, 0.79, 0.75), (0.58, 0.06, 0.05), (0.03, 0.05, 0.13)
_CHARCOAL, _GREY, _YELLOW = (0.03, 0.03, 0.035), (0.11, 0.11, 0.12), (0.72, 0.50, 0.05)


@dataclass(frozen=True)
class Lens:
    """A pinhole camera. Pixel (column, row) is centred on whole numbers, as data sets have it."""

    matrix: Array
    """[3, 3] px"""
    turn: Array
    """Room to camera [3, 3]: x right, y down, z into the picture."""
    shift: Array
    """[3] m"""
    size: int

    def see(self, points: Array) -> tuple[Array, Array]:
        """Columns and rows [..., 2], and depth [...], of points of the room."""
        inside = points @ self.turn.T + self.shift
        seen = inside @ self.matrix.T
        return seen[..., :2] / seen[..., 2:], inside[..., 2]


def lens_on_ring(degrees: float, height_m: float, distance_m: float, size: int) -> Lens:
    """A camera round the person, 0 where the training camera stands, looking at the middle."""
    around = np.radians(degrees)
    eye = np.array([distance_m * np.sin(around), -distance_m * np.cos(around), height_m])
    forward = np.array([0.0, 0.0, 0.92]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])
    focal = 1.42 * size
    middle = 0.5 * size - 0.5
    matrix = np.array([[focal, 0.0, middle], [0.0, focal, middle], [0.0, 0.0, 1.0]])
    return Lens(matrix, turn, -turn @ eye, size)


def take(
    figure: Figure, vertices: Array, normals: Array, lens: Lens
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Picture [S, S, 3] (sRGB, the wall where nobody is) and alpha [S, S] of the posed figure.

    The colour of a pixel that the person covers in part is the person's alone.
    """
    n, wide = SAMPLES_A_SIDE, SAMPLES_A_SIDE * lens.size
    columns_rows, depths = lens.see(vertices)
    found, shares = nearest_triangles(n * (columns_rows + 0.5), depths, figure.faces, wide, wide)
    rows, columns = np.nonzero(found >= 0)
    corners = figure.faces[found[rows, columns]]
    share = shares[rows, columns].astype(np.float64)[:, :, None]
    rest = (figure.vertices[corners] * share).sum(axis=1)
    normal = (normals[corners] * share).sum(axis=1)
    light = cloth(rest) * irradiance(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    pixel = (rows // n) * lens.size + columns // n
    pixels = lens.size**2
    count = np.bincount(pixel, minlength=pixels)
    total = np.stack([np.bincount(pixel, light[:, c], pixels) for c in range(3)], axis=1)
    picture = np.empty((pixels, 3), np.uint8)
    picture[:] = _WALL
    covered = count > 0
    picture[covered] = coded(total[covered] / count[covered, None])
    alpha = np.round(255.0 * count / n**2).astype(np.uint8)
    return picture.reshape(lens.size, lens.size, 3), alpha.reshape(lens.size, lens.size)


def irradiance(normals: Array) -> Array:
    """Of the room at `normals` [N, 3], over pi [N, 1]: a key light, the sky, the ground."""
    sky = _GROUND + (_SKY - _GROUND) * (0.5 + 0.5 * normals[:, 2:])
    return sky + _KEY * np.maximum(normals @ _KEY_FROM, 0.0)[:, None]


def coded(linear: Array) -> NDArray[np.uint8]:
    """sRGB in 8 bits (IEC 61966-2-1)."""
    low, high = 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1.0 / 2.4) - 0.055
    value = np.where(linear <= 0.0031308, low, high)
    return np.round(255.0 * np.clip(value, 0.0, 1.0)).astype(np.uint8)


def cloth(rest: Array) -> Array:
    """Albedo [N, 3], linear, at points of the T-pose [N, 3]."""
    x, y, z = rest.T
    across = np.abs(x)
    albedo = np.empty_like(rest)
    trunk = across < 0.21
    albedo[:] = np.where(_even(y, 0.045)[:, None], _WHITE, _NAVY)  # stripes of the shirt
    sleeve = ~trunk
    albedo[sleeve] = np.where(_even(x[sleeve], 0.06)[:, None], _WHITE, _RED)
    _paint(albedo, (np.hypot(x, y - 0.09) < 0.075) & (z > 0.0), _YELLOW)  # print on the chest
    cross = (np.minimum(np.abs(x), np.abs(y - 0.09)) < 0.014) & (np.hypot(x, y - 0.09) < 0.06)
    _paint(albedo, cross & (z > 0.0), _NAVY)
    _paint(albedo, (np.abs(x) < 0.055) & (np.abs(y - 0.06) < 0.09) & (z < 0.0), _RED)
    trousers = (y < -0.235) & (across < 0.3)
    check = _even(np.arctan2(z, across - 0.1), np.pi / 5.0) == _even(y, 0.062)
    albedo[trousers] = np.where(check[trousers, None], _CHARCOAL, _GREY)
    _paint(albedo, trousers & (y > -0.265), _YELLOW)  # belt
    _paint(albedo, trousers & (y < -1.085), _RED)  # shoes
    _paint(albedo, trousers & (y < -1.185), _WHITE)
    _paint(albedo, across > 0.675, _SKIN)
    _paint(albedo, (y > 0.268) & (across < 0.12), _SKIN)
    head = (y > 0.3) & (across < 0.2)
    _paint(albedo, head & ((y > 0.505) | ((z < 0.03) & (y > 0.36) & (across < 0.074))), _HAIR)
    face = head & (z > 0.06)
    _paint(albedo, face & (np.hypot((across - 0.034) / 1.5, y - 0.437) < 0.0085), _WHITE)
    _paint(albedo, face & (np.hypot(across - 0.034, y - 0.437) < 0.007), _HAIR)
    _paint(albedo, face & (np.abs(across - 0.034) < 0.019) & (np.abs(y - 0.462) < 0.005), _HAIR)
    _paint(albedo, face & (np.hypot(x / 2.6, y - 0.362) < 0.0095), _LIP)
    return albedo


def _even(value: Array, period: float) -> NDArray[np.bool_]:
    return np.floor(2.0 * value / period) % 2.0 == 0.0


def _paint(albedo: Array, where: NDArray[np.bool_], colour: tuple[float, ...]) -> None:
    albedo[where] = colour
