"""The room behind a performer: a textured box with furniture, fixed in the world, random by seed.

Moderate contrast, straight edges and clutter, as in a home, which segmentation has to cope with.
Walls are drawn into textures, which are sampled where rays leave the box.
"""

from __future__ import annotations

import colorsys

import cv2
import numpy as np

from scene.arrays import Array, Float, UInt8
from scene.camera import Camera

_HALF_WIDTH_M, _HEIGHT_M, _BACK_M = 3.0, 2.8, -1.8
"""The box: x from -3 to 3, y from 0 to 2.8, z from -1.8 to behind the camera."""
_BEHIND_CAMERA_M = 1.0
_FLOOR_DEPTH_M = 12.0
_TEXTURE_PX_PER_M = 256
_SUPERSAMPLING = 3
Colour = tuple[float, float, float]
"""sRGB in [0, 255]."""
_SATURATION = 0.75
"""Share of the colours' saturation and brightness kept: the room is duller than the person."""


def room_background(camera: Camera, seed: int) -> Float[Array, "H W 3"]:
    """The empty room of `seed` seen by `camera`: sRGB in [0, 1]."""
    rng = np.random.default_rng([seed, 0x700D])
    wall = _hsv(rng.uniform(), rng.uniform(0.08, 0.25), rng.uniform(0.65, 0.8))
    back_wall, side_wall, floor = _back_wall(rng, wall), _wallpaper(wall, 2.0), _planks(rng)
    supersampled = camera.resized(camera.width * _SUPERSAMPLING, camera.height * _SUPERSAMPLING)
    origins, directions = supersampled.rays()
    directions = np.where(np.abs(directions) < 1e-9, 1e-9, directions)
    front = max(float(camera.position[2]), 0.0) + _BEHIND_CAMERA_M
    low = np.array([-_HALF_WIDTH_M, 0.0, _BACK_M])
    high = np.array([_HALF_WIDTH_M, _HEIGHT_M, front])
    exit_distance = np.maximum((low - origins) / directions, (high - origins) / directions)
    axis = exit_distance.argmin(axis=-1)
    hit = origins + np.take_along_axis(exit_distance, axis[..., None], axis=-1) * directions
    x, y, z = (hit[..., i] for i in range(3))
    samples = np.full((*axis.shape, 3), 205.0, np.float32)  # the ceiling
    for selected, picture, u_m, v_m in (
        ((axis == 2) & (z < 0.0), back_wall, x + _HALF_WIDTH_M, _HEIGHT_M - y),
        ((axis == 2) & (z >= 0.0), side_wall, x + _HALF_WIDTH_M, _HEIGHT_M - y),
        (axis == 0, side_wall, z - _BACK_M, _HEIGHT_M - y),
        ((axis == 1) & (y < 0.5 * _HEIGHT_M), floor, x + _HALF_WIDTH_M, z - _BACK_M),
    ):
        samples[selected] = _sample_texture(picture, u_m[selected], v_m[selected])
    shape = (camera.height, _SUPERSAMPLING, camera.width, _SUPERSAMPLING, 3)
    pixels = samples.reshape(shape).mean(axis=(1, 3))
    pixels = _SATURATION * pixels + (1.0 - _SATURATION) * 0.6 * pixels.mean(axis=-1, keepdims=True)
    return (pixels / 255.0).astype(np.float32)


def _sample_texture(picture: Array, u_m: Array, v_m: Array) -> Array:
    """Nearest texels at metres from the top left corner; the texture repeats."""
    rows, columns = picture.shape[:2]
    x = np.mod((u_m * _TEXTURE_PX_PER_M).astype(np.int64), columns)
    y = np.mod((v_m * _TEXTURE_PX_PER_M).astype(np.int64), rows)
    return picture[y, x]


def _hsv(hue: float, saturation: float, value: float) -> Colour:
    red, green, blue = colorsys.hsv_to_rgb(hue % 1.0, saturation, value)
    return 255.0 * red, 255.0 * green, 255.0 * blue


def _dimmed(colour: Colour, share: float) -> Colour:
    red, green, blue = colour
    return share * red, share * green, share * blue


def _px(metres: float) -> int:
    return round(metres * _TEXTURE_PX_PER_M)


def _rectangle(
    picture: Array,
    left: float,
    top: float,
    right: float,
    bottom: float,
    colour: Colour,
) -> None:
    """A filled rectangle, m from the top left corner."""
    cv2.rectangle(picture, (_px(left), _px(top)), (_px(right), _px(bottom)), colour, -1)


def _wallpaper(wall: Colour, width_m: float) -> UInt8[Array, "H W 3"]:
    """Striped paper above a panelled lower part and a skirting board."""
    picture = np.empty((_px(_HEIGHT_M), _px(width_m), 3), np.uint8)
    picture[:] = wall
    stripe = np.mod(np.arange(picture.shape[1]), _px(0.25)) < _px(0.11)
    picture[:, stripe] = 0.92 * np.asarray(wall)
    shade = 1.0 - 0.12 * np.linspace(0.0, 1.0, len(picture))[:, None, None]
    picture = (picture * shade).astype(np.uint8)
    _rectangle(picture, 0.0, _HEIGHT_M - 0.12, width_m, _HEIGHT_M, (214, 208, 198))
    _rectangle(picture, 0.0, _HEIGHT_M - 0.125, width_m, _HEIGHT_M - 0.115, (120, 112, 104))
    return picture


def _back_wall(rng: np.random.Generator, wall: Colour) -> UInt8[Array, "H W 3"]:
    """Papered, with a bookcase, a window and pictures; placed at random."""
    picture = _wallpaper(wall, 2.0 * _HALF_WIDTH_M)
    sides = [1.25, 4.0] if rng.uniform() < 0.5 else [4.0, 1.25]
    _bookcase(picture, rng, sides[0], 0.8)
    _window(picture, rng, sides[1], 0.35)
    _cabinet(picture, rng, sides[1], 2.05)
    for left, top in ((2.35, 0.3), (3.1, 0.45)):
        _framed_picture(picture, rng, left + rng.uniform(-0.05, 0.05), top)
    return picture


def _bookcase(picture: Array, rng: np.random.Generator, left: float, top: float) -> None:
    wood, right = _hsv(rng.uniform(0.05, 0.1), 0.5, rng.uniform(0.3, 0.5)), left + 0.8
    _rectangle(picture, left, top, right, _HEIGHT_M, wood)
    shelves = np.linspace(top + 0.04, _HEIGHT_M - 0.1, 6)
    for above, below in zip(shelves[:-1], shelves[1:] - 0.03, strict=True):
        _rectangle(picture, left + 0.03, above, right - 0.03, below, (58, 50, 44))
        place = left + 0.04
        while place < right - 0.08:
            thick = rng.uniform(0.015, 0.05)
            if rng.uniform() < 0.85:  # else a gap
                tall = rng.uniform(0.6, 0.92) * (below - above)
                cover = _hsv(rng.uniform(), rng.uniform(0.2, 0.6), rng.uniform(0.3, 0.75))
                _rectangle(picture, place, below - tall, place + thick - 0.004, below, cover)
                band = below - rng.uniform(0.3, 0.8) * tall
                _rectangle(
                    picture, place, band, place + thick - 0.004, band + 0.01, (190, 178, 140)
                )
            place += thick


def _window(picture: Array, rng: np.random.Generator, left: float, top: float) -> None:
    width, height = 0.85, 1.3
    _rectangle(picture, left, top, left + width, top + height, (222, 220, 214))
    for column in range(2):
        for row in range(2):
            x, y = left + 0.05 + column * 0.39, top + 0.05 + row * 0.62
            rows, columns = _px(0.57), _px(0.36)
            light = np.linspace(1.0, 0.86, rows)[:, None, None] * np.array([188, 204, 220])
            picture[_px(y) : _px(y) + rows, _px(x) : _px(x) + columns] = light
            if row == 1:  # trees outside
                for _ in range(7):
                    middle = (_px(x + rng.uniform(0.05, 0.31)), _px(y + rng.uniform(0.38, 0.5)))
                    green = _hsv(rng.uniform(0.22, 0.36), 0.4, rng.uniform(0.3, 0.55))
                    cv2.circle(picture, middle, _px(rng.uniform(0.03, 0.055)), green, -1)
    cloth = _hsv(rng.uniform(), rng.uniform(0.2, 0.5), rng.uniform(0.4, 0.65))
    for start in (left - 0.16, left + width - 0.06):
        for fold in range(5):
            shade = _dimmed(cloth, 1.0 - 0.13 * (fold % 2))
            x = start + 0.044 * fold
            _rectangle(picture, x, top - 0.06, x + 0.044, top + height + 0.2, shade)


def _cabinet(picture: Array, rng: np.random.Generator, left: float, top: float) -> None:
    wood = _hsv(rng.uniform(0.05, 0.12), 0.4, rng.uniform(0.4, 0.65))
    _rectangle(picture, left - 0.1, top, left + 0.95, _HEIGHT_M - 0.03, wood)
    dark = _dimmed(wood, 0.7)
    for drawer in range(3):
        y = top + 0.03 + 0.23 * drawer
        cv2.rectangle(
            picture, (_px(left - 0.07), _px(y)), (_px(left + 0.92), _px(y + 0.2)), dark, 3
        )
        cv2.circle(picture, (_px(left + 0.42), _px(y + 0.1)), _px(0.015), (206, 190, 140), -1)
    pot = _hsv(rng.uniform(), 0.5, 0.5)
    _rectangle(picture, left + 0.62, top - 0.14, left + 0.78, top, pot)
    for _ in range(16):
        tip = (_px(left + 0.7 + rng.uniform(-0.2, 0.2)), _px(top - rng.uniform(0.2, 0.42)))
        green = _hsv(rng.uniform(0.25, 0.38), 0.5, rng.uniform(0.25, 0.5))
        cv2.line(picture, (_px(left + 0.7), _px(top - 0.14)), tip, green, 6)


def _framed_picture(picture: Array, rng: np.random.Generator, left: float, top: float) -> None:
    width, height = rng.uniform(0.4, 0.55), rng.uniform(0.45, 0.65)
    _rectangle(picture, left, top, left + width, top + height, (70, 56, 44))
    _rectangle(
        picture,
        left + 0.03,
        top + 0.03,
        left + width - 0.03,
        top + height - 0.03,
        _hsv(rng.uniform(), 0.2, 0.8),
    )
    for _ in range(9):
        middle = (
            _px(left + rng.uniform(0.12, width - 0.12)),
            _px(top + rng.uniform(0.12, height - 0.12)),
        )
        axes = (_px(rng.uniform(0.02, 0.08)), _px(rng.uniform(0.02, 0.08)))
        colour = _hsv(rng.uniform(), rng.uniform(0.2, 0.6), rng.uniform(0.35, 0.8))
        cv2.ellipse(picture, middle, axes, float(rng.uniform(0, 180)), 0, 360, colour, -1)


def _planks(rng: np.random.Generator) -> UInt8[Array, "H W 3"]:
    """A wooden floor, planks along z, and a rug where the performer stands."""
    picture = np.empty((_px(_FLOOR_DEPTH_M), _px(2.0 * _HALF_WIDTH_M), 3), np.uint8)
    hue, deep = rng.uniform(0.06, 0.1), rng.uniform(0.45, 0.6)
    wide = 0.14
    for column in range(int(2.0 * _HALF_WIDTH_M / wide) + 1):
        start = -rng.uniform(0.0, 1.2)
        while start < _FLOOR_DEPTH_M:
            board = _hsv(hue, 0.4, deep * rng.uniform(0.85, 1.1))
            x = column * wide
            _rectangle(picture, x, max(start, 0.0), x + wide, start + 1.2, board)
            gap = _dimmed(board, 0.6)
            _rectangle(picture, x, max(start, 0.0), x + 0.004, start + 1.2, gap)
            _rectangle(picture, x, max(start, 0.0), x + wide, max(start, 0.0) + 0.004, gap)
            start += 1.2
    hue = rng.uniform()
    for ring in range(6):
        inset, tone = 0.09 * ring, 0.62 if ring % 2 else 0.45
        _rectangle(
            picture,
            1.9 + inset,
            1.0 + inset,
            4.1 - inset,
            2.9 - inset,
            _hsv(hue + 0.07 * (ring % 3), 0.3, tone),
        )
    return picture
