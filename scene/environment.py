"""Environment, performers and scene: the input of a rendered view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from scene.arrays import Array, Float
from scene.lighting import LUMINANCE, Lighting, lighting_of, panorama_directions
from scene.live_appearance import LiveAppearance
from scene.motion import Pose

Model = TypeVar("Model", covariant=True)


@dataclass(frozen=True, eq=False)
class Environment:
    """Surroundings of the performers: a panorama and its light, or a plain studio.

    The studio is a floor at y = 0 under a sky, linear gradients in sRGB, and leaves the light on
    everybody as captured.
    """

    name: str = "studio"
    horizon: tuple[float, float, float] = (0.86, 0.88, 0.91)
    zenith: tuple[float, float, float] = (0.55, 0.62, 0.72)
    floor: tuple[float, float, float] = (0.62, 0.60, 0.58)
    shadow_strength: float = 0.45
    """Darkness of the contact shadow under a performer, 0 to 1."""
    panorama: Float[Array, "H W 3"] | None = None
    """Linear radiance all round, exposed: 1 is white; see `scene.lighting` for its axes."""
    lighting: Lighting | None = None
    """The light that falls on performers; None leaves them as they were captured."""

    @classmethod
    def of_panorama(
        cls, name: str, panorama: Float[Array, "H W 3"], turn_rad: float = 0.0
    ) -> Environment:
        """The place that `panorama` (any unit of radiance) shows, turned about +y, and its light.

        Exposed so that a white surface just reaches 1 where the light falls on it most. Raises
        InvalidInput for a panorama that is none.
        """
        width = panorama.shape[1]
        rotated = np.roll(panorama, -round(turn_rad / (2.0 * np.pi) * width), axis=1)
        lighting = lighting_of(rotated)
        gain = exposure(lighting)
        return cls(name, panorama=rotated * gain, lighting=lighting.scaled(gain))


def exposure(lighting: Lighting) -> float:
    """The gain with which the brightest side of a white body has a luminance of 1."""
    normals = panorama_directions(32, 64).reshape(-1, 3)
    return 1.0 / float((lighting.shading(normals) @ LUMINANCE).max())


@dataclass(frozen=True, eq=False)
class Performer(Generic[Model]):
    """A trained model placed in the room, in its current pose."""

    name: str
    model: Model
    position: Float[Array, "3"]
    """Where the model's own origin stands on the floor, m."""
    yaw_rad: float
    """Turn about +y; 0 leaves the model facing the way it was captured."""
    pose: Pose
    appearance: LiveAppearance | None = None
    """How their webcam sees them now; None: as their model was captured."""

    @property
    def placement(self) -> Float[Array, "4 4"]:
        """Model's world -> room."""
        return placement(self.position, self.yaw_rad)


@dataclass(frozen=True, eq=False)
class Scene(Generic[Model]):
    """Everything a view is rendered from."""

    environment: Environment
    performers: tuple[Performer[Model], ...]


def placement(position: Float[Array, "3"], yaw_rad: float) -> Float[Array, "4 4"]:
    """The rigid transform that rotates by `yaw_rad` about +y, then translates to `position` (m)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    matrix = np.eye(4)
    matrix[:3, :3] = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]]
    matrix[:3, 3] = position
    return matrix
