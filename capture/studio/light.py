"""Diffuse light of a panorama on the studio's performers, summed over every pixel.

The reference for `scene.lighting`, which approximates it by spherical harmonics and a key light.
Neither knows of shadows that a body casts on itself.
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float
from scene.colour import to_linear, to_srgb
from scene.lighting import panorama_directions, require_panorama, solid_angles

_NORMALS = (48, 96)
_POOLED_ROWS = 128
"""Panoramas with more rows are first summed to about so many."""


class EnvironmentLight:
    """Irradiance of a panorama over pi, by surface normal: what white, matt surfaces show."""

    def __init__(self, panorama: Float[Array, "H W 3"]) -> None:
        require_panorama(panorama)
        power = panorama * solid_angles(*panorama.shape[:2])[..., None]
        pooling = max(1, panorama.shape[0] // _POOLED_ROWS)
        rows, columns = (side // pooling for side in panorama.shape[:2])
        cropped = power[: rows * pooling, : columns * pooling]
        pooled = cropped.reshape(rows, pooling, columns, pooling, 3).sum(axis=(1, 3)).reshape(-1, 3)
        directions = panorama_directions(rows, columns).reshape(-1, 3)
        normals = panorama_directions(*_NORMALS).reshape(-1, 3)
        irradiance = [
            np.maximum(block @ directions.T, 0.0) @ pooled for block in np.array_split(normals, 24)
        ]
        self._table = (np.concatenate(irradiance) / np.pi).reshape(*_NORMALS, 3).astype(np.float32)

    def shading(self, normals: Float[Array, "N 3"]) -> Float[Array, "N 3"]:
        """E of `normals` (any length), linear RGB."""
        rows, columns = _NORMALS
        x, y, z = normals.T
        column = (np.arctan2(z, x) / (2.0 * np.pi) + 0.5) * columns - 0.5
        row = np.clip((0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * rows - 0.5, 0.0, rows - 1.001)
        left, upper = np.floor(column).astype(int), row.astype(int)
        across, down = (column - left)[:, None], (row - upper)[:, None]
        above, below = (
            (1.0 - across) * self._table[at, left % columns]
            + across * self._table[at, (left + 1) % columns]
            for at in (upper, upper + 1)
        )
        return (1.0 - down) * above + down * below

    def shade(
        self, albedo: Float[Array, "N 3"], normals: Float[Array, "N 3"]
    ) -> Float[Array, "N 3"]:
        """sRGB of surfaces of sRGB `albedo`."""
        return to_srgb(to_linear(albedo) * self.shading(normals))
