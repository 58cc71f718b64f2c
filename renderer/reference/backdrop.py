"""The plain twin of `compositing/backdrop_kernels.py`: whole arrays, one formula a line."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float, UInt8
from scene.camera import Camera

FADE_M, LINE_HALF_WIDTH_M, LINE_DARKNESS = 14.0, 0.008, 0.16


def compose(
    rgba: Float[Array, "H W 4"],
    camera: Camera,
    colours: Float[Array, "3 3"],
    shadows: Float[Array, "S 4"],
) -> UInt8[Array, "H W 3"]:
    """sRGB bytes of premultiplied `rgba` over the room; colours: horizon, zenith, floor."""
    horizon, zenith, floor = colours
    _, directions = camera.rays()
    eye, up = camera.position, directions[..., 1:2]
    sky = horizon + (zenith - horizon) * np.sqrt(np.maximum(up, 0.0))

    down = np.minimum(up, -1e-9)
    far = -eye[1] / down
    ground = eye + far * directions
    footprint = far / camera.focal_px / np.maximum(-down, 0.05) + 1e-6
    cover = np.maximum(_line(ground[..., :1], footprint), _line(ground[..., 2:], footprint))
    light = 1.0 - LINE_DARKNESS * cover
    for x, z, radius, strength in shadows:
        spread = ((ground[..., :1] - x) ** 2 + (ground[..., 2:] - z) ** 2) / radius**2
        light = light * (1.0 - strength * np.exp(-spread))
    fade = np.exp(-far / FADE_M)
    room = np.where((up < 0.0) & (eye[1] > 0.0), horizon + (floor * light - horizon) * fade, sky)
    shown = rgba[..., :3] + (1.0 - rgba[..., 3:]) * room
    return (np.clip(shown, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def _line(x: Float[Array, "H W 1"], footprint: Float[Array, "H W 1"]) -> Float[Array, "H W 1"]:
    away = np.abs(x - np.floor(x + 0.5))
    edge = np.clip((LINE_HALF_WIDTH_M - away) / footprint + 0.5, 0.0, 1.0)
    return edge * np.minimum(1.0, 2.0 * LINE_HALF_WIDTH_M / footprint)
