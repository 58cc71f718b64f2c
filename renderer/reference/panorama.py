"""The plain twin of `compositing/panorama_kernels.py`: whole arrays, one formula a line."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float, UInt8
from scene.camera import Camera

PANORAMA_HEIGHT_M, DOME_RADIUS_M = 1.6, 8.0


def compose_panorama(
    rgba: Float[Array, "H W 4"],
    camera: Camera,
    picture: Float[Array, "h w 3"],
    shadows: Float[Array, "S 4"],
) -> UInt8[Array, "H W 3"]:
    """sRGB bytes of premultiplied `rgba` over the place that the sRGB panorama shows."""
    _, directions = camera.rays()
    eye, centre = camera.position, np.array([0.0, PANORAMA_HEIGHT_M, 0.0])
    down = np.minimum(directions[..., 1:2], -1e-9)
    ground = eye - eye[1] / down * directions
    inside = (
        np.hypot(ground[..., :1], ground[..., 2:]) ** 2 < DOME_RADIUS_M**2 - PANORAMA_HEIGHT_M**2
    )
    on_floor = (directions[..., 1:2] < 0.0) & (eye[1] > 0.0) & inside
    offset = eye - centre
    half = directions @ offset
    along = -half + np.sqrt(np.maximum(half**2 - offset @ offset + DOME_RADIUS_M**2, 0.0))
    dome = eye + along[..., None] * directions
    towards = np.where(on_floor, ground, dome) - centre
    light = np.ones_like(down)
    for x, z, radius, strength in shadows:
        spread = ((ground[..., :1] - x) ** 2 + (ground[..., 2:] - z) ** 2) / radius**2
        light = light * (1.0 - strength * np.exp(-spread))
    place = np.where(on_floor, light, 1.0) * _sample(picture, towards)
    shown = rgba[..., :3] + (1.0 - rgba[..., 3:]) * place
    return (np.clip(shown, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def _sample(picture: Float[Array, "h w 3"], towards: Float[Array, "H W 3"]) -> Array:
    rows, columns = picture.shape[:2]
    x, y, z = np.moveaxis(towards, -1, 0)
    u = (np.arctan2(z, x) / (2.0 * np.pi) + 0.5) * columns - 0.5
    v = np.clip((0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * rows - 0.5, 0.0, rows - 1.001)
    left, top = np.floor(u).astype(int), v.astype(int)
    across, down = (u - left)[..., None], (v - top)[..., None]
    upper, lower = (
        (1.0 - across) * picture[row, left % columns] + across * picture[row, (left + 1) % columns]
        for row in (top, top + 1)
    )
    return (1.0 - down) * upper + down * lower
