"""Light that falls on people: an equirectangular panorama, its spherical harmonics, one key light.

Radiance L of a panorama is linear RGB. E(n) is irradiance over pi: what a white, matt surface with
normal n shows. E(n) = sum_i harmonics_i Y_i(n) + key max(n.d, 0), with Y_i the nine real spherical
harmonics up to order 2, whose coefficients are those of L times A_l / pi = 1, 2/3, 1/4
(Ramamoorthi and Hanrahan 2001, equations 8 and 12). Nine numbers blur what is small and bright: the
brightest part is taken out first and kept as a light from one direction d.

Columns of a panorama run round the vertical, the middle one towards +x and the one a quarter
further towards +z; rows from straight up to straight down (three.js's equirectangular mapping).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scene.arrays import Array, Float
from scene.checks import require_finite, require_shape
from scene.errors import InvalidInput

HARMONICS = 9
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of linear sRGB (Rec. 709)."""
_KEY_RADIUS_RAD = 0.35
"""What lies so near to the brightest place is the key light, as far as it outshines the rest."""
_KEY_TIMES = 4.0
"""The key light begins at so many times the mean radiance."""
_CONVOLVED = np.repeat([1.0, 2.0 / 3.0, 1.0 / 4.0], [1, 3, 5])


@dataclass(frozen=True, eq=False)
class Lighting:
    """Light from all sides, smooth, and from one direction, sharp."""

    harmonics: Float[Array, "9 3"]
    """Coefficients of E without the key light."""
    key_direction: Float[Array, "3"]
    """Unit vector towards the key light."""
    key_colour: Float[Array, "3"]
    """What a white surface that faces the key light shows by it alone; nil where there is none."""

    def __post_init__(self) -> None:
        for name, shape in (
            ("harmonics", (HARMONICS, 3)),
            ("key_direction", (3,)),
            ("key_colour", (3,)),
        ):
            require_shape(name, getattr(self, name), shape)
            require_finite(name, getattr(self, name))
        length = float(np.linalg.norm(self.key_direction))
        if abs(length - 1.0) > 1e-3:
            raise InvalidInput(f"key_direction must be of unit length; got length {length:.3g}")

    def shading(self, normals: Float[Array, "N 3"]) -> Float[Array, "N 3"]:
        """E of unit `normals`, linear RGB, never negative."""
        facing = np.maximum(normals @ self.key_direction, 0.0)
        smooth = np.maximum(harmonic_basis(normals) @ self.harmonics, 0.0)
        return smooth + facing[:, None] * self.key_colour

    def scaled(self, gain: Float[Array, "3"] | float) -> Lighting:
        """As a camera with this gain (one, or one a channel) sees it."""
        return replace(self, harmonics=self.harmonics * gain, key_colour=self.key_colour * gain)


def harmonic_basis(directions: Float[Array, "N 3"]) -> Float[Array, "N 9"]:
    """Real spherical harmonics up to order 2 of unit vectors: orthonormal over the sphere."""
    x, y, z = directions.T
    return np.stack(
        [
            np.full_like(x, 0.282095),
            0.488603 * y,
            0.488603 * z,
            0.488603 * x,
            1.092548 * x * y,
            1.092548 * y * z,
            0.315392 * (3.0 * z * z - 1.0),
            1.092548 * x * z,
            0.546274 * (x * x - y * y),
        ],
        axis=1,
    )


def panorama_directions(height: int, width: int) -> Float[Array, "H W 3"]:
    """Unit vectors towards the pixels' centres of a panorama."""
    azimuth = ((np.arange(width) + 0.5) / width - 0.5) * 2.0 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    level = np.cos(elevation)[:, None]
    return np.stack(
        [
            level * np.cos(azimuth),
            np.broadcast_to(np.sin(elevation)[:, None], (height, width)),
            level * np.sin(azimuth),
        ],
        axis=-1,
    )


def solid_angles(height: int, width: int) -> Float[Array, "H 1"]:
    """Of the pixels of each row, sr; over the whole panorama they sum to 4 pi."""
    edges = np.cos(np.arange(height + 1) / height * np.pi)
    return ((edges[:-1] - edges[1:]) * 2.0 * np.pi / width)[:, None]


def lighting_of(panorama: Float[Array, "H W 3"]) -> Lighting:
    """The light of a panorama of linear radiance. Raises InvalidInput for none that gives light."""
    require_panorama(panorama)
    height, width = panorama.shape[:2]
    directions, angles = panorama_directions(height, width), solid_angles(height, width)
    luminance = panorama @ LUMINANCE
    mean = float((luminance * angles).sum() / (4.0 * np.pi))
    if mean <= 0.0:
        raise InvalidInput(f"panorama must give light; got a mean radiance of {mean:g}")
    threshold = _KEY_TIMES * mean
    excess = np.maximum(luminance - threshold, 0.0) * angles
    key_direction, key_colour = np.array([0.0, 1.0, 0.0]), np.zeros(3)
    rest = panorama
    if excess.any():
        near = _near_the_brightest(excess, directions)
        share = np.where(near, np.maximum(1.0 - threshold / np.maximum(luminance, 1e-12), 0.0), 0.0)
        taken = panorama * share[..., None]
        rest = panorama - taken
        power = (taken * angles[..., None]).sum(axis=(0, 1))
        towards = np.einsum("hwx,hw->x", directions, (taken @ LUMINANCE) * angles)
        key_direction, key_colour = towards / np.linalg.norm(towards), power / np.pi
    basis = harmonic_basis(directions.reshape(-1, 3)).reshape(height, width, HARMONICS)
    coefficients = np.einsum("hwi,hwc->ic", basis * angles[..., None], rest)
    return Lighting(coefficients * _CONVOLVED[:, None], key_direction, key_colour)


def require_panorama(panorama: Float[Array, "H W 3"]) -> None:
    """Raise InvalidInput unless it is twice as wide as high, finite and not negative."""
    require_shape("panorama", panorama, (None, None, 3))
    height, width = panorama.shape[:2]
    if width != 2 * height:
        raise InvalidInput(
            f"panorama must be twice as wide as high (equirectangular); got {width} x {height}"
        )
    require_finite("panorama", panorama)
    if panorama.min() < 0.0:
        raise InvalidInput(f"panorama must not be negative anywhere; got {panorama.min():g}")


def _near_the_brightest(excess: Float[Array, "H W"], directions: Float[Array, "H W 3"]) -> Array:
    """Where the panorama is within the key light's radius of its brightest place."""
    candidates = np.argsort(excess, axis=None)[-64:]
    places = directions.reshape(-1, 3)[candidates]
    reach = np.cos(_KEY_RADIUS_RAD)
    power = [(excess * (directions @ place > reach)).sum() for place in places]
    return directions @ places[int(np.argmax(power))] > reach
