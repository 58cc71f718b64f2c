"""One person, many frames: the unit of upload and of training. No I/O here: readers bring it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from collections.abc import Sequence as Many
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np

from scene.arrays import Array, Float, UInt8
from scene.body import Body
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.motion import Motion, Pose
from scene.pose_trust import PoseTrust

NOVEL_VIEW = "novel_view"
"""Test split: moments of the training motion from unseen cameras."""
UNSEEN_POSE = "unseen_pose"
"""Test split: other motion, unseen cameras."""
_APART_S = 60.0
"""Between the frames of two sequences that are joined."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One moment seen by one camera."""

    image: Float[Array, "H W 3"]
    """The person over black: sRGB in [0, 1], premultiplied by `mask`."""
    mask: Float[Array, "H W"]
    """Soft alpha of the person in [0, 1]."""
    camera: Camera
    pose: Pose


@runtime_checkable
class FrameSource(Protocol):
    """Frames read lazily; the readers live in capture/."""

    def __len__(self) -> int: ...

    def camera(self, index: int) -> Camera:
        """The camera of frame `index`, at the size of its image."""
        ...

    def pose(self, index: int) -> Pose:
        """The pose of frame `index`."""
        ...

    def image(self, index: int) -> Float[Array, "H W 3"]:
        """float32 sRGB in [0, 1], premultiplied by the mask."""
        ...

    def mask(self, index: int) -> Float[Array, "H W"]:
        """float32 alpha in [0, 1]."""
        ...


@dataclass(frozen=True, eq=False)
class Crop:
    """A frame cut to the person."""

    rgba: UInt8[Array, "H W 4"]
    """The person over black, premultiplied, sRGB, and alpha: `image` and `mask` in 8 bits."""
    rows: slice
    columns: slice
    """Where in the frame it is."""


@runtime_checkable
class CropSource(FrameSource, Protocol):
    """Frames on disk, of which only the person is taken; several threads may ask at once."""

    def crop(self, index: int, margin: float) -> Crop:
        """Frame `index` cut to its `body_crop`; the whole frame where nobody is in it."""
        ...


@dataclass(frozen=True, eq=False)
class Sequence:
    """A person's frames for training, and test frames where truth is known."""

    person: str
    frames_per_second: float
    body: Body
    train: FrameSource
    data_hash: str
    """sha256 (hex) of everything a model may learn from."""
    motion: Motion
    """Poses of the training frames, with confidences."""
    test: Mapping[str, FrameSource] = field(default_factory=dict)
    """Splits `novel_view` and `unseen_pose`; empty for a captured clip."""
    pose_trust: PoseTrust = PoseTrust.ESTIMATED

    def __post_init__(self) -> None:
        if len(self.train) != len(self.motion):
            raise InvalidInput(
                f"a sequence must have one pose a training frame; got {len(self.train)} frames "
                f"and {len(self.motion)} poses"
            )

    def frame(self, index: int) -> Frame:
        """Training frame `index`, read now."""
        return read_frame(self.train, index)

    def part(self, indices: Many[int]) -> Sequence:
        """The same with some of its training frames, in increasing order; itself with all."""
        if len(indices) == len(self.train):
            return self
        train = _SomeFrames(self.train, tuple(indices))
        return replace(self, train=train, motion=self.motion.part(indices))

    def followed_by(self, other: Sequence) -> Sequence:
        """The same with the training frames of `other`, of the same person in the same clothes,
        behind its own, long after them: no motion leads from these to those.

        Poses of `other` are brought to this body: its pelvis stays where it was.
        """
        pelvis = other.body.skeleton.rest_joints[0] - self.body.skeleton.rest_joints[0]
        late_s = self.motion.times_s[-1] + _APART_S - other.motion.times_s[0]
        moved = replace(
            other.motion,
            times_s=other.motion.times_s + late_s,
            root_translation=other.motion.root_translation + pelvis,
        )
        motion = self.motion.followed_by(moved)
        digest = hashlib.sha256(f"{self.data_hash} {other.data_hash}".encode()).hexdigest()
        train = _SuccessiveFrames(self.train, other.train, motion)
        return replace(self, train=train, motion=motion, data_hash=digest)


@dataclass(frozen=True, eq=False)
class _SomeFrames:
    """Some frames of a source (a `FrameSource`)."""

    source: FrameSource
    indices: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.indices)

    def camera(self, index: int) -> Camera:
        return self.source.camera(self.indices[index])

    def pose(self, index: int) -> Pose:
        return self.source.pose(self.indices[index])

    def image(self, index: int) -> Float[Array, "H W 3"]:
        return self.source.image(self.indices[index])

    def mask(self, index: int) -> Float[Array, "H W"]:
        return self.source.mask(self.indices[index])


@dataclass(frozen=True, eq=False)
class _SuccessiveFrames:
    """Frames of one source behind those of another (a `FrameSource`)."""

    first: FrameSource
    then: FrameSource
    motion: Motion
    """Of all."""

    def __len__(self) -> int:
        return len(self.motion)

    def camera(self, index: int) -> Camera:
        source, own = self._place(index)
        return source.camera(own)

    def pose(self, index: int) -> Pose:
        return self.motion.pose(index)

    def image(self, index: int) -> Float[Array, "H W 3"]:
        source, own = self._place(index)
        return source.image(own)

    def mask(self, index: int) -> Float[Array, "H W"]:
        source, own = self._place(index)
        return source.mask(own)

    def _place(self, index: int) -> tuple[FrameSource, int]:
        count = len(self.first)
        return (self.first, index) if index < count else (self.then, index - count)


def read_frame(source: FrameSource, index: int) -> Frame:
    """Frame `index` of any source, read now."""
    return Frame(source.image(index), source.mask(index), source.camera(index), source.pose(index))


def crop_window(
    mask: Float[Array, "H W"] | UInt8[Array, "H W"], margin: float
) -> tuple[slice, slice]:
    """The `body_crop` of `mask`; the whole of it where nobody is in it."""
    return body_crop(mask, margin) or (slice(0, mask.shape[0]), slice(0, mask.shape[1]))


def body_crop(
    mask: Float[Array, "H W"] | UInt8[Array, "H W"], margin: float = 0.05
) -> tuple[slice, slice] | None:
    """Rows and columns of the box around alpha > 0 grown by `margin` of its size; None if empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return None
    spans = []
    for found, side in ((rows, mask.shape[0]), (columns, mask.shape[1])):
        grow = int(np.ceil(margin * (found[-1] + 1 - found[0])))
        first, last = int(found[0]) - grow, int(found[-1]) + 1 + grow
        spans.append(slice(max(0, first), min(side, last)))
    return spans[0], spans[1]
