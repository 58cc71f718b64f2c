"""Pinhole cameras in the OpenCV convention: x right, y down, z forward, metres and pixels.

Pixel i covers [i, i + 1), so its centre is at i + 0.5. `world_to_camera` is [R | t] with
x_camera = R x_world + t. The world is right-handed with y up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scene.arrays import Array, Float
from scene.checks import require_finite, require_shape
from scene.errors import InvalidInput
from scene.rotations import axis_angle_to_matrix

_UNDISTORT_ROUNDS = 20
"""Fixed-point rounds; the residual is far below 1e-6 px for the distortions of webcams."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One view: where it stands and how it maps rays to pixels."""

    intrinsics: Float[Array, "3 3"]
    """K, pixels; no skew is assumed away."""
    world_to_camera: Float[Array, "3 4"]
    """[R | t], metres."""
    width: int
    height: int
    distortion: Float[Array, "5"] | None = None
    """k1, k2, p1, p2, k3 of OpenCV's model, or None for a pure pinhole."""

    def __post_init__(self) -> None:
        for name, shape in (("intrinsics", (3, 3)), ("world_to_camera", (3, 4))):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            require_shape(name, value, shape)
            require_finite(name, value)
            object.__setattr__(self, name, value)
        if self.distortion is not None:
            value = np.asarray(self.distortion, dtype=np.float64)
            require_shape("distortion", value, (5,))
            require_finite("distortion", value)
            object.__setattr__(self, "distortion", value)
        if self.width < 1 or self.height < 1:
            size = (self.width, self.height)
            raise InvalidInput(f"width and height must be at least 1 px; got {size}")
        _require_invertible(self.intrinsics, self.rotation)

    @classmethod
    def from_field_of_view(
        cls, world_to_camera: Float[Array, "3 4"], width: int, height: int, fov_y_rad: float
    ) -> Camera:
        """A camera with square pixels and its principal point in the middle.

        Raises InvalidInput unless 0 < fov_y_rad < pi.
        """
        if not 0.0 < fov_y_rad < np.pi:
            raise InvalidInput(f"fov_y_rad must be between 0 and pi; got {fov_y_rad!r}")
        focal_px = 0.5 * height / np.tan(0.5 * fov_y_rad)
        intrinsics = np.array(
            [[focal_px, 0.0, 0.5 * width], [0.0, focal_px, 0.5 * height], [0.0, 0.0, 1.0]]
        )
        return cls(intrinsics, world_to_camera, width, height)

    @property
    def rotation(self) -> Float[Array, "3 3"]:
        """R of world_to_camera."""
        return self.world_to_camera[:, :3]

    @property
    def translation(self) -> Float[Array, "3"]:
        """t of world_to_camera, m."""
        return self.world_to_camera[:, 3]

    @property
    def position(self) -> Float[Array, "3"]:
        """The camera's centre in the world, m."""
        return -self.rotation.T @ self.translation

    @property
    def focal_px(self) -> float:
        """Vertical focal length, pixels."""
        return float(self.intrinsics[1, 1])

    @property
    def fov_y_rad(self) -> float:
        """Vertical field of view, rad."""
        return float(2.0 * np.arctan(0.5 * self.height / self.focal_px))

    def project(
        self, points: Float[Array, "*batch 3"]
    ) -> tuple[Float[Array, "*batch 2"], Float[Array, "*batch"]]:
        """Pixels and depths (m along z) of world points.

        Points at or behind the camera have depth <= 0; their pixels are meaningless, not an error.
        """
        in_camera = points @ self.rotation.T + self.translation
        depth = in_camera[..., 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        plane = in_camera[..., :2] / safe[..., None]
        if self.distortion is not None:
            plane = _distort(plane, self.distortion)
        pixels = plane @ self.intrinsics[:2, :2].T + self.intrinsics[:2, 2]
        return pixels, depth

    def unproject(
        self, pixels: Float[Array, "*batch 2"], depth: Float[Array, "*#batch"]
    ) -> Float[Array, "*batch 3"]:
        """World points seen at `pixels` at `depth` (m along z); the inverse of `project`."""
        in_camera = self._plane_points(pixels) * depth[..., None]
        return (in_camera - self.translation) @ self.rotation

    def rays(self) -> tuple[Float[Array, "H W 3"], Float[Array, "H W 3"]]:
        """Origins (m) and unit directions of the rays through all pixel centres, in the world."""
        u, v = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        directions = self._plane_points(np.stack([u, v], axis=-1)) @ self.rotation
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.position, directions.shape), directions

    def resized(self, width: int, height: int) -> Camera:
        """The same view in `width` x `height` pixels (box-filter geometry: no half-pixel shift)."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return replace(self, intrinsics=scale @ self.intrinsics, width=width, height=height)

    def cropped(self, x: int, y: int, width: int, height: int) -> Camera:
        """The view through the window whose top left pixel is (x, y); it may leave the image."""
        shift = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
        return replace(self, intrinsics=shift @ self.intrinsics, width=width, height=height)

    def carried_round(self, middle: Float[Array, "3"], angle_rad: float) -> Camera:
        """The same camera, carried round the vertical through `middle`: to the left of somebody who
        faces it for angles above 0."""
        turn = axis_angle_to_matrix(np.array([0.0, -angle_rad, 0.0]))
        rotation = self.rotation @ turn
        translation = self.rotation @ (middle - turn @ middle) + self.translation
        moved = np.concatenate([rotation, translation[:, None]], axis=1)
        return replace(self, world_to_camera=moved)

    def _plane_points(self, pixels: Float[Array, "*batch 2"]) -> Float[Array, "*batch 3"]:
        """Points of the plane z = 1 (camera frame) behind pixels, distortion removed."""
        plane = (pixels - self.intrinsics[:2, 2]) @ np.linalg.inv(self.intrinsics[:2, :2]).T
        if self.distortion is not None:
            target = plane
            for _ in range(_UNDISTORT_ROUNDS):
                plane = plane + target - _distort(plane, self.distortion)
        return np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)


def look_at(
    eye: Float[Array, "3"] | Sequence[float],
    target: Float[Array, "3"] | Sequence[float],
    up: Sequence[float] = (0.0, 1.0, 0.0),
) -> Float[Array, "3 4"]:
    """world_to_camera of a camera at `eye` that looks at `target` with `up` towards the top.

    Raises InvalidInput where the direction is nil or parallel to `up`.
    """
    eye, target = np.asarray(eye, dtype=np.float64), np.asarray(target, dtype=np.float64)
    forward = target - eye
    right = np.cross(forward, np.asarray(up, dtype=np.float64))
    if np.linalg.norm(right) < 1e-9:
        raise InvalidInput(
            f"target - eye must not be nil or parallel to up; got {forward.tolist()} and {up}"
        )
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return np.concatenate([rotation, (-rotation @ eye)[:, None]], axis=1)


def orbit_camera(
    target: Float[Array, "3"] | Sequence[float],
    distance_m: float,
    azimuth_rad: float,
    elevation_rad: float,
    width: int,
    height: int,
    fov_y_rad: float = 0.6,
) -> Camera:
    """A camera on a sphere around `target`.

    Azimuth 0 stands in front of a person who faces +z, +pi/2 at +x (the person's left);
    elevation is positive above `target`.
    """
    direction = np.array(
        [
            np.sin(azimuth_rad) * np.cos(elevation_rad),
            np.sin(elevation_rad),
            np.cos(azimuth_rad) * np.cos(elevation_rad),
        ]
    )
    eye = np.asarray(target, dtype=np.float64) + distance_m * direction
    return Camera.from_field_of_view(look_at(eye, target), width, height, fov_y_rad)


def _distort(plane: Float[Array, "*batch 2"], k: Float[Array, "5"]) -> Float[Array, "*batch 2"]:
    """OpenCV's radial and tangential model on the plane z = 1."""
    x, y = plane[..., 0], plane[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    dx = 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x)
    dy = k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y
    return np.stack([x * radial + dx, y * radial + dy], axis=-1)


def _require_invertible(intrinsics: Float[Array, "3 3"], rotation: Float[Array, "3 3"]) -> None:
    determinant = float(np.linalg.det(intrinsics))
    if abs(determinant) < 1e-9 or intrinsics[0, 0] <= 0.0 or intrinsics[1, 1] <= 0.0:
        raise InvalidInput(
            f"intrinsics must be invertible with positive focal lengths; got determinant "
            f"{determinant:g} and focal lengths {intrinsics[0, 0]:g}, {intrinsics[1, 1]:g} px"
        )
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > 1e-3 or np.linalg.det(rotation) < 0.0:
        raise InvalidInput(
            "world_to_camera must hold a rotation (orthonormal, determinant +1); got "
            f"determinant {float(np.linalg.det(rotation)):g}, off by {error:.2g}"
        )
