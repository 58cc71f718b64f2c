"""What one measurement trains on and is judged by, whole in memory, so that it can be spoilt."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.stability.precision import PRECISIONS
from capture.studio.garments import Drape
from capture.studio.performer import FilmedPerformer
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.sequence import NOVEL_VIEW, Frame, FrameSource, PoseTrust, Sequence, read_frame


@dataclass(frozen=True, eq=False)
class FrameList:
    """Frames in memory (a `FrameSource`)."""

    frames: tuple[Frame, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def camera(self, index: int) -> Camera:
        """The camera of frame `index`."""
        return self.frames[index].camera

    def pose(self, index: int) -> Pose:
        """The pose of frame `index`."""
        return self.frames[index].pose

    def image(self, index: int) -> Float[Array, "H W 3"]:
        """sRGB in [0, 1], premultiplied by the mask."""
        return self.frames[index].image

    def mask(self, index: int) -> Float[Array, "H W"]:
        """Alpha in [0, 1]."""
        return self.frames[index].mask


@dataclass(frozen=True, eq=False)
class Material:
    """A clip, perhaps spoilt, and the clean frames that a model of it is judged by."""

    body: Body
    frames_per_second: float
    train: tuple[Frame, ...]
    """As training gets them."""
    judged: tuple[Frame, ...]
    """Clean frames of cameras that training never saw."""
    successive: tuple[tuple[Frame, Frame], ...]
    """Clean frames of the training camera that follow one another: flicker is told by them."""
    true_motion: Motion
    """Of the training camera's clean frames."""
    seed: int = 0
    """Of the training."""
    precision: str = PRECISIONS[0]
    """That the model is stored in before it is judged, of `PRECISIONS`."""

    def sequence(self, trust: PoseTrust) -> Sequence:
        """What training gets."""
        motion = Motion.from_poses([frame.pose for frame in self.train])
        return Sequence(
            person="somebody",
            frames_per_second=self.frames_per_second,
            body=self.body,
            train=FrameList(self.train),
            data_hash="stability",
            motion=motion,
            test={NOVEL_VIEW: FrameList(self.judged)},
            pose_trust=trust,
        )

    def with_train(self, frames: Iterable[Frame]) -> Material:
        """The same, trained on `frames`."""
        return replace(self, train=tuple(frames))

    def everywhere(self, change: Callable[[Frame], Frame]) -> Material:
        """The same with every frame changed, clean ones too."""
        return replace(
            self,
            train=tuple(map(change, self.train)),
            judged=tuple(map(change, self.judged)),
            successive=tuple((change(early), change(late)) for early, late in self.successive),
        )


@dataclass(frozen=True, eq=False)
class Stage:
    """A studio performer who can be filmed again, in another pose, shutter or garment."""

    performer: FilmedPerformer
    look: str

    def frame(self, pose: Pose, camera: Camera, cloth: Drape | None = None) -> Frame:
        """The truth: `pose` from `camera`; in loose clothes, where they are given."""
        if cloth is None:
            image, mask = self.performer.render(pose, camera, self.look)
        else:
            image, mask = self.performer.render(pose, camera, "loose", cloth.at(pose.time_s))
        return Frame(image, mask, camera, pose)


@dataclass(frozen=True, eq=False)
class Subject:
    """Whom an axis is measured with."""

    name: str
    material: Material
    """Undisturbed."""
    stage: Stage | None = None
    """None of real people, and of clothes that the studio has to simulate anew."""
    filmed: bool = False
    """A real person, whose poses a capture found."""


def frames_of(source: FrameSource, indices: Iterable[int]) -> tuple[Frame, ...]:
    """Frames of a source, read now."""
    return tuple(read_frame(source, int(index)) for index in indices)


def spread(length: int, count: int) -> list[int]:
    """`count` indices, or all, evenly over `length`."""
    return np.unique(np.linspace(0, length - 1, min(count, length)).round().astype(int)).tolist()
