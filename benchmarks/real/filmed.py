"""A clip of a case: decoded at its own resolution, captured, and cut into training and test."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real.ruler import Ruler
from capture.pipeline import CaptureOptions, capture_clip
from capture.sources.video import Clip, read_video
from capture.storage import open_sequence
from scene.arrays import Array
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.motion import Pose
from scene.sequence import Sequence

_WHOLE_PX = 4096
_ALL_FRAMES = 100_000


@dataclass(frozen=True, eq=False)
class FilmedClip:
    """A clip as its camera filmed it, and what the capture made of it."""

    ruler: Ruler
    footage: Clip
    sequence: Sequence
    camera: Camera
    """Of the whole picture, in the capture's world."""
    report: dict[str, Any]
    capture_s: float
    focal_px: float
    """Of the pictures that the capture worked with."""

    def index_of(self, time_s: float) -> int:
        """The number of the frame that was filmed at `time_s`."""
        return int(np.abs(self.footage.times_s - time_s).argmin())

    def pose(self, index: int) -> Pose:
        """The captured pose of frame `index`."""
        return self.sequence.motion.pose_at(float(self.footage.times_s[index]))

    def without_ruler(self) -> Sequence:
        """What can be trained on where the ruler's frames judge."""
        times, judged = self.sequence.motion.times_s, self.ruler.indices
        kept = [i for i, time_s in enumerate(times) if self.index_of(float(time_s)) not in judged]
        return part_of(self.sequence, kept)

    def training_part(self, share: float) -> tuple[Sequence, list[int]]:
        """The first `share` of the clip to train on, and the numbers of its frames."""
        last = share * (len(self.footage.images) - 1)
        times = self.sequence.motion.times_s
        kept = [i for i, time_s in enumerate(times) if self.index_of(float(time_s)) <= last]
        numbers = [self.index_of(float(times[i])) for i in kept]
        return part_of(self.sequence, kept), numbers


def film(
    ruler: Ruler,
    footage: Path,
    folder: Path,
    options: CaptureOptions,
    captured_focal_px: float | None = None,
) -> FilmedClip:
    """Read and capture the clip of `ruler` into `folder`, with its given focal length, if any.

    Args:
        captured_focal_px: what an earlier capture into `folder` found: it is taken from there.
    """
    path = ruler.require_footage(footage)
    focals = [] if captured_focal_px is None else [captured_focal_px]
    report, begun = dict[str, Any](), time.perf_counter()
    if not focals:
        quality = capture_clip(
            path, folder, options, on_fit=lambda _, fit: focals.append(fit.focal_px)
        )
        report = quality.as_json()
    capture_s = time.perf_counter() - begun
    whole = read_video(path, max_frames=_ALL_FRAMES, max_side=_WHOLE_PX)
    sequence = open_sequence(folder)
    filmed_width, _ = whole.source_size
    focal_px = focals[-1] * filmed_width / read_width(path)
    camera = whole_camera(sequence.train.camera(0), focal_px, whole.source_size)
    return FilmedClip(ruler, whole, sequence, camera, report, capture_s, focals[-1])


def read_width(path: Path) -> int:
    """Width of the pictures that a capture of `path` works with, px."""
    return read_video(path, max_frames=2).images[0].shape[1]


def whole_camera(stored: Camera, focal_px: float, size: tuple[int, int]) -> Camera:
    """The camera of the whole picture, of which `stored` is a part at another scale.

    Args:
        focal_px: of the whole picture, whose principal point is its middle.
        size: width and height of the whole picture, px.
    """
    scales = np.diag(stored.intrinsics)[:2] / focal_px
    corner = 0.5 * np.array(size) - stored.intrinsics[:2, 2] / scales
    x, y = np.rint(corner).astype(int).tolist()
    unscaled = np.diag([*(1.0 / scales), 1.0]) @ stored.intrinsics
    width, height = np.rint(np.array([stored.width, stored.height]) / scales).astype(int).tolist()
    part = Camera(unscaled, stored.world_to_camera, width, height)
    return part.cropped(-x, -y, *size)


def require_unseen(trained: Iterable[Array], tested: Iterable[Array]) -> None:
    """Raises InvalidInput where a picture is in both, by sha256 of its pixels."""
    seen = {_digest(image) for image in trained}
    again = [number for number, image in enumerate(tested) if _digest(image) in seen]
    if again:
        raise InvalidInput(
            f"test frames must not have been trained on; got {len(again)} that were, the first "
            f"is test frame {again[0]}; judge another clip or a later part"
        )


def _digest(image: Array) -> bytes:
    return hashlib.sha256(np.ascontiguousarray(image).tobytes()).digest()


def part_of(sequence: Sequence, kept: list[int]) -> Sequence:
    """Those of its training frames that are `kept`."""
    if len(kept) == len(sequence.train):
        return sequence
    digest = hashlib.sha256(f"{sequence.data_hash} {kept}".encode()).hexdigest()
    return replace(sequence.part(kept), data_hash=digest)
