"""What readers of data sets share: pictures with a background made ours, and the world set upright.

Their pixels are centred on integers (OpenCV), ours on halves; their lenses are undone here as they
do it (cv2.undistort), so the cameras that come out are plain pinholes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence as Series
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from capture.errors import BrokenDataset
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle, rotation_between
from scene.skeleton import JOINT_NAMES, Skeleton

_SOLE_M = 0.02
"""How high the lowest joint, a toe, is above the sole."""
_FLOOR_TOLERANCE_M = 0.05
"""A floor this near to y = 0 is left where it is."""


@dataclass(frozen=True, eq=False)
class DatasetFrame:
    """Where one frame lies on disk, and the lens it was seen through."""

    picture: Path
    masks: tuple[Path, ...]
    """Joined: the person is where any of them says so."""
    camera: Camera
    labels: bool = False
    """Masks hold numbers of body parts, not alpha: whatever is not black is the person."""
    lens: tuple[Float[Array, "3 3"], Float[Array, "5"]] | None = None
    """Their K and k1, k2, p1, p2, k3; None for a pinhole."""


@dataclass(frozen=True, eq=False)
class DatasetFrames:
    """Frames of a data set, read from disk when asked for (a `FrameSource`)."""

    shots: Series[DatasetFrame]
    motion: Motion
    """One pose a shot at increasing times; a moment seen by several cameras has `moments`."""
    moments: Series[int]
    """Which pose of the motion each shot shows."""

    def __len__(self) -> int:
        return len(self.shots)

    def camera(self, index: int) -> Camera:
        """The camera of frame `index`."""
        return self.shots[index].camera

    def pose(self, index: int) -> Pose:
        """The pose of frame `index`."""
        return self.motion.pose(self.moments[index])

    def image(self, index: int) -> Float[Array, "H W 3"]:
        """float32 sRGB in [0, 1], premultiplied. Raises BrokenDataset for what is no picture."""
        shot = self.shots[index]
        pixels = self._straight(_read(shot.picture, shot.camera), shot)
        person = pixels[..., ::-1].astype(np.float32) / np.float32(255.0)
        return person * self.mask(index)[..., None]

    def mask(self, index: int) -> Float[Array, "H W"]:
        """float32 alpha in [0, 1]. Raises BrokenDataset for what is no picture."""
        shot = self.shots[index]
        masks = [_read(path, shot.camera).max(axis=-1) for path in shot.masks]
        alpha = np.max(masks, axis=0)
        if shot.labels or alpha.max() == 1:  # many tools write 1 for the person
            alpha = np.where(alpha > 0, np.uint8(255), np.uint8(0))
        alpha = self._straight(alpha, shot)
        return alpha.astype(np.float32) / np.float32(255.0)

    @staticmethod
    def _straight(pixels: Array, shot: DatasetFrame) -> Array:
        return pixels if shot.lens is None else cv2.undistort(pixels, *shot.lens)


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height, px. Raises BrokenDataset for what is no picture."""
    pixels = _decode(path)
    return pixels.shape[1], pixels.shape[0]


def our_intrinsics(theirs: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """K for pixels centred on halves, of K for pixels centred on integers."""
    return theirs + np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])


def their_intrinsics(ours: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """The inverse of `our_intrinsics`."""
    return ours - np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])


def rest_skeleton(joints: Float[Array, "24 3"]) -> Skeleton:
    """`joints` (T-pose, m) with the pelvis at x = z = 0 and the soles on y = 0."""
    low = float(joints[:, 1].min())
    on_floor = 0.0 if 0.0 < low < 2.0 * _FLOOR_TOLERANCE_M else low - _SOLE_M
    return Skeleton(joints - [joints[0, 0], on_floor, joints[0, 2]])


def upright_world(
    skeleton: Skeleton,
    global_orient: Float[Array, "F 3"],
    pelvis: Float[Array, "F 3"],
    body_pose: Float[Array, "F 23 3"],
    times_s: Float[Array, "F"],
) -> tuple[Motion, Float[Array, "4 4"]]:
    """The motion in a world whose y is up and whose floor is y = 0, and their world -> ours.

    The axis nearest to the person's own up, on average, is up: data sets have z up, or y down. A
    world that is ours already stays as it is.
    """
    turned = axis_angle_to_matrix(global_orient)
    mean_up = turned[:, :, 1].mean(axis=0)
    nearest = np.zeros(3)
    nearest[np.abs(mean_up).argmax()] = np.sign(mean_up[np.abs(mean_up).argmax()])
    ours = np.eye(4)
    ours[:3, :3] = rotation_between(nearest, np.array([0.0, 1.0, 0.0])).round()
    angles = np.concatenate(
        [matrix_to_axis_angle(ours[:3, :3] @ turned)[:, None], body_pose], axis=1
    )
    root = pelvis @ ours[:3, :3].T - skeleton.rest_joints[0]
    floor = skeleton.ground_height(angles, root)
    if abs(floor) > _FLOOR_TOLERANCE_M:
        ours[1, 3] = -floor
        root = root - [0.0, floor, 0.0]
    return Motion(times_s, angles, root, np.ones((len(angles), len(JOINT_NAMES)))), ours


def moved_camera(
    world_to_camera: Float[Array, "3 4"], ours: Float[Array, "4 4"]
) -> Float[Array, "3 4"]:
    """`world_to_camera` of their world, for our world."""
    return world_to_camera @ np.linalg.inv(ours)


def data_hash(root: Path, files: Series[Path]) -> str:
    """sha256 (hex) over the names and bytes of `files`, in their order."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.relative_to(root).as_posix().encode())
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


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
