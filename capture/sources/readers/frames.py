"""What readers of data sets share: undistorted, premultiplied pictures and an upright world.

Data sets centre pixels on integers (OpenCV), sequences on halves. Pictures are undistorted as
cv2.undistort does it, which the data sets' own code calls, so the resulting cameras are pinholes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence as Series
from dataclasses import dataclass
from functools import cache, lru_cache, reduce
from pathlib import Path

import cv2
import numpy as np

from capture.errors import BrokenDataset
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle, rotation_between
from scene.sequence import Crop, crop_window
from scene.skeleton import JOINT_NAMES, Skeleton

_SOLE_M = 0.02
"""How high the lowest joint, a toe, is above the sole."""
_KEPT_MAPS = 4
"""Lenses whose undistortion is kept in memory, 6 MB each at 1024 x 1024."""
_FLOOR_TOLERANCE_M = 0.05
"""A floor this near to y = 0 is not moved."""


@dataclass(frozen=True, eq=False)
class DatasetFrame:
    """Files of one frame, and its camera."""

    picture: Path
    masks: tuple[Path, ...]
    """Their union is the person's mask."""
    camera: Camera
    labels: bool = False
    """Masks hold labels of body parts instead of alpha: every label but 0 is the person."""
    lens: tuple[Float[Array, "3 3"], Float[Array, "5"]] | None = None
    """Intrinsics of the data set and k1, k2, p1, p2, k3; None for a pinhole."""


@dataclass(frozen=True, eq=False)
class DatasetFrames:
    """Frames of a data set, read from disk when asked for (a `CropSource`)."""

    frames: Series[DatasetFrame]
    motion: Motion
    """Poses at increasing times; frames of several cameras may share one."""
    pose_indices: Series[int]
    """Index of each frame's pose in the motion."""

    def __len__(self) -> int:
        return len(self.frames)

    def camera(self, index: int) -> Camera:
        """The camera of frame `index`."""
        return self.frames[index].camera

    def pose(self, index: int) -> Pose:
        """The pose of frame `index`."""
        return self.motion.pose(self.pose_indices[index])

    def image(self, index: int) -> Float[Array, "H W 3"]:
        """float32 sRGB in [0, 1], premultiplied. Raises BrokenDataset for an unreadable picture."""
        frame = self.frames[index]
        pixels = _undistorted(_read(frame.picture, frame.camera), frame)
        person = pixels[..., ::-1].astype(np.float32) / np.float32(255.0)
        return person * self.mask(index)[..., None]

    def mask(self, index: int) -> Float[Array, "H W"]:
        """float32 alpha in [0, 1]. Raises BrokenDataset for an unreadable picture."""
        return self._alpha(index).astype(np.float32) / np.float32(255.0)

    def crop(self, index: int, margin: float) -> Crop:
        """See `scene.sequence.CropSource`. Raises BrokenDataset for an unreadable picture."""
        frame, alpha = self.frames[index], self._alpha(index)
        rows, columns = crop_window(alpha, margin)
        alpha = alpha[rows, columns]
        pixels = _undistorted(_read(frame.picture, frame.camera), frame, rows, columns)
        rgba = np.empty((*alpha.shape, 4), np.uint8)
        rgba[..., :3] = pixels[..., ::-1]
        rgba[..., 3] = alpha
        rgba[alpha == 0] = 0
        soft = (alpha > 0) & (alpha < 255)  # the few at which there is anything to multiply
        rgba[soft, :3] = _premultiplied()[rgba[soft, :3], alpha[soft, None]]
        return Crop(rgba, rows, columns)

    def _alpha(self, index: int) -> UInt8[Array, "H W"]:
        frame = self.frames[index]
        pictures = [_read(path, frame.camera) for path in frame.masks]
        alpha = reduce(np.maximum, (one[..., c] for one in pictures for c in range(3)))
        if frame.labels or alpha.max() == 1:  # many tools write 1 for the person
            alpha = np.where(alpha > 0, np.uint8(255), np.uint8(0))
        return _undistorted(alpha, frame)


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height, px. Raises BrokenDataset for an unreadable picture."""
    pixels = _decode(path)
    return pixels.shape[1], pixels.shape[0]


def to_half_pixel_centres(intrinsics: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """K for pixels centred on halves, of K for pixels centred on integers."""
    return intrinsics + np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])


def to_integer_pixel_centres(intrinsics: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """The inverse of `to_half_pixel_centres`."""
    return intrinsics - np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])


def rest_skeleton(joints: Float[Array, "24 3"]) -> Skeleton:
    """`joints` (T-pose, m) with the pelvis at x = z = 0 and the soles on y = 0."""
    lowest = float(joints[:, 1].min())
    floor = 0.0 if 0.0 < lowest < 2.0 * _FLOOR_TOLERANCE_M else lowest - _SOLE_M
    return Skeleton(joints - [joints[0, 0], floor, joints[0, 2]])


def upright_world(
    skeleton: Skeleton,
    global_orient: Float[Array, "F 3"],
    pelvis: Float[Array, "F 3"],
    body_pose: Float[Array, "F 23 3"],
    times_s: Float[Array, "F"],
) -> tuple[Motion, Float[Array, "4 4"]]:
    """The motion in a world with y up and the floor at y = 0, and dataset_to_world [4, 4].

    The axis nearest to the mean up direction of the person is up: data sets have z up, or y down.
    A world that fulfils this already is not changed.
    """
    rotations = axis_angle_to_matrix(global_orient)
    mean_up = rotations[:, :, 1].mean(axis=0)
    up = np.zeros(3)
    up[np.abs(mean_up).argmax()] = np.sign(mean_up[np.abs(mean_up).argmax()])
    dataset_to_world = np.eye(4)
    dataset_to_world[:3, :3] = rotation_between(up, np.array([0.0, 1.0, 0.0])).round()
    angles = np.concatenate(
        [matrix_to_axis_angle(dataset_to_world[:3, :3] @ rotations)[:, None], body_pose], axis=1
    )
    root = pelvis @ dataset_to_world[:3, :3].T - skeleton.rest_joints[0]
    floor = skeleton.ground_height(angles, root)
    if abs(floor) > _FLOOR_TOLERANCE_M:
        dataset_to_world[1, 3] = -floor
        root = root - [0.0, floor, 0.0]
    return Motion(times_s, angles, root, np.ones((len(angles), len(JOINT_NAMES)))), dataset_to_world


def camera_in_world(
    world_to_camera: Float[Array, "3 4"], dataset_to_world: Float[Array, "4 4"]
) -> Float[Array, "3 4"]:
    """`world_to_camera` of the data set's world, for the upright world."""
    return world_to_camera @ np.linalg.inv(dataset_to_world)


def data_hash(root: Path, files: Series[Path]) -> str:
    """sha256 (hex) over the names and bytes of `files`, in their order."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.relative_to(root).as_posix().encode())
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _undistorted(
    pixels: UInt8[Array, "H W *C"],
    frame: DatasetFrame,
    rows: slice = slice(None),
    columns: slice = slice(None),
) -> UInt8[Array, "h w *C"]:
    """Those rows and columns of the undistorted picture."""
    if frame.lens is None:
        return pixels[rows, columns]
    intrinsics, distortion = (np.asarray(part, np.float64).tobytes() for part in frame.lens)
    from_px, fractions = _undistortion(intrinsics, distortion, *pixels.shape[:2])
    return cv2.remap(pixels, from_px[rows, columns], fractions[rows, columns], cv2.INTER_LINEAR)


@lru_cache(maxsize=_KEPT_MAPS)
def _undistortion(
    intrinsics: bytes, distortion: bytes, height: int, width: int
) -> tuple[Array, Array]:
    """Where cv2.undistort takes every pixel from, and which fraction of a pixel beside."""
    matrix = np.frombuffer(intrinsics).reshape(3, 3)
    coefficients = np.frombuffer(distortion)
    return cv2.initUndistortRectifyMap(
        matrix, coefficients, None, matrix, (width, height), cv2.CV_16SC2
    )


@cache
def _premultiplied() -> UInt8[Array, "256 256"]:
    """A colour times an alpha, both in 8 bits, rounded as the product of their float32."""
    values = np.arange(256, dtype=np.float32) / np.float32(255.0)
    return (values[:, None] * values * 255.0 + 0.5).astype(np.uint8)


def _read(path: Path, camera: Camera) -> Array:
    pixels = _decode(path)
    if pixels.shape[:2] != (camera.height, camera.width):
        raise BrokenDataset(
            f"{path.name} must be as large as the camera's first picture ({camera.width} x "
            f"{camera.height}); got {pixels.shape[1]} x {pixels.shape[0]}"
        )
    return pixels


def _decode(path: Path) -> Array:
    pixels = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.exists() else None
    if pixels is None:
        size = f"{path.stat().st_size} bytes" if path.exists() else "no file"
        raise BrokenDataset(f"{path} must be a picture; got {size}; fetch it again")
    return pixels
