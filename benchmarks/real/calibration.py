"""Calibrated cameras of other programs, and where they stand in the world of a capture."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np

from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.errors import InvalidInput

_UNITS_A_PIXEL = 64.0
_MM = 1e-3
_HIDDEN_COLUMNS = 4.0
"""The walker's videos show 1080 of the sensor's 1088 columns, from the middle."""


@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """OpenCV's axes, px and m."""

    intrinsics: Float[Array, "3 3"]
    distortion: Float[Array, "5"]
    rotation: Float[Array, "3 3"]
    translation: Float[Array, "3"]

    def undistorted(self, picture: Array) -> Array:
        """The picture of a pinhole with these intrinsics; itself where nothing is distorted."""
        if not self.distortion.any():
            return picture
        return cv2.undistort(picture, self.intrinsics, self.distortion)

    def undistorted_points(self, points: Float[Array, "P 2"]) -> Float[Array, "P 2"]:
        """Where the pinhole sees what was seen at `points`, px."""
        return cv2.undistortPoints(
            points[:, None], self.intrinsics, self.distortion, P=self.intrinsics
        )[:, 0]


def read_calibration(path: Path, clip: str) -> CalibratedCamera:
    """The camera that filmed the ruler's `clip`, whose name ends with the camera's number.

    Raises InvalidInput where the file is neither Qualisys' (.txt, XML) nor caliscope's (.toml), or
    has no such camera.
    """
    number = re.search(r"\d+$", clip)
    if number is not None and path.suffix == ".toml":
        camera = tomllib.loads(path.read_text())["cameras"].get(number.group())
        if camera is not None:
            return CalibratedCamera(
                *(
                    np.array(camera[name], np.float64)
                    for name in ("matrix", "distortions", "rotation", "translation")
                )
            )
    if number is not None and path.suffix == ".txt":
        found = ElementTree.parse(path).find(f".//camera[@serial='cam{number.group()}']")
        if found is not None:
            return _qualisys(found)
    raise InvalidInput(f"calibration must name the camera of {clip!r}; got {path.name}")


def _qualisys(camera: ElementTree.Element) -> CalibratedCamera:
    transform, inner = camera.find("transform"), camera.find("intrinsic")
    assert transform is not None
    assert inner is not None
    rows = [[float(transform.attrib[f"r{r}{c}"]) for c in "123"] for r in "123"]
    rotation = np.diag([1.0, -1.0, -1.0]) @ np.array(rows)  # Qualisys looks along -z
    position = _MM * np.array([float(transform.attrib[axis]) for axis in "xyz"])
    focal, centre = (
        [float(inner.attrib[f"{name}{axis}"]) / _UNITS_A_PIXEL for axis in "UV"]
        for name in ("focalLength", "centerPoint")
    )
    intrinsics = np.diag([*focal, 1.0])
    intrinsics[:2, 2] = centre[0] - _HIDDEN_COLUMNS, centre[1]
    return CalibratedCamera(intrinsics, np.zeros(5), rotation, -rotation @ position)


def in_capture(
    own: Camera,
    trained: CalibratedCamera,
    other: CalibratedCamera,
    scale: float,
    size: tuple[int, int],
) -> Camera:
    """`other` in the world of a capture whose metre is `1 / scale` of the true one.

    Args:
        own: the whole picture of the `trained` camera as the capture placed it; its principal
            point is the picture's middle, which makes up for the true one by a small rotation.
    """
    offset = (own.intrinsics[:2, 2] - trained.intrinsics[:2, 2]) / trained.intrinsics[0, 0]
    tilt = cv2.Rodrigues(np.array([-offset[1], offset[0], 0.0]))[0]
    between = other.rotation @ trained.rotation.T
    shift = other.translation - between @ trained.translation
    rotation = between @ tilt @ own.rotation
    translation = between @ tilt @ own.translation + shift / scale
    pose = np.concatenate([rotation, translation[:, None]], axis=1)
    return Camera(other.intrinsics, pose, *size)


def undistorted_image(
    camera: CalibratedCamera | None, image: UInt8[Array, "H W 3"]
) -> UInt8[Array, "H W 3"]:
    """`image` as a pinhole sees it; itself for a camera that nobody calibrated."""
    return image if camera is None else camera.undistorted(image)
