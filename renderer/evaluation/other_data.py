"""Data that a model was not trained on, as the model's own body stands in it.

A capture estimates how large a person is, and two captures of one person disagree. Seen by one
camera nothing changes when body, path and distance grow alike, so the other data's world is given
the size of the model, and each pose the model's pelvis in the place of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.motion import Pose
from scene.sequence import FrameSource, Sequence
from scene.skeleton import Skeleton

_LEAST_BONE_M = 0.05
"""Shorter bones, as of a foot's ball, say little about proportions."""
_SAME_PERSON = 0.15
"""Standard deviation of the logarithms of bone lengths' ratios up to which two bodies may be one
person's: captures of one person lie within 0.05."""


def size_ratio(skeleton: Skeleton, other: Skeleton) -> float:
    """How many times as large `skeleton` is as `other`: the geometric mean of its bones' ratios.

    Raises InvalidInput where the proportions are not one person's.
    """
    lengths = [_bone_lengths(one) for one in (skeleton, other)]
    long = np.minimum(*lengths) > _LEAST_BONE_M
    ratios = np.log(lengths[0][long] / lengths[1][long])
    if (spread := float(ratios.std())) > _SAME_PERSON:
        raise InvalidInput(
            "a model can be evaluated on data of the same person alone; got bodies whose bones "
            f"differ in proportion by {100 * spread:.0f} % (at most {100 * _SAME_PERSON:.0f} %); "
            "name the data that it was trained on, or another clip of that person"
        )
    return float(np.exp(ratios.mean()))


def on_body_of(model: PerformerModel, sequence: Sequence) -> Sequence:
    """`sequence`, whose cameras and poses show what they did when `model` is posed by them.

    Raises InvalidInput where the bodies are not one person's.
    """
    theirs = sequence.body.skeleton
    scale = size_ratio(model.skeleton, theirs)

    def moved(source: FrameSource) -> FrameSource:
        return _Resized(
            source, scale, scale * theirs.rest_joints[0] - model.skeleton.rest_joints[0]
        )

    tests = {split: moved(source) for split, source in sequence.test.items()}
    return replace(sequence, train=moved(sequence.train), test=tests)


@dataclass(frozen=True, eq=False)
class _Resized:
    """Frames in a world `scale` times as large (a `FrameSource`)."""

    source: FrameSource
    scale: float
    offset: Float[Array, "3"]
    """From the model's pelvis at rest to the other one's, in the larger world, m."""

    def __len__(self) -> int:
        return len(self.source)

    def camera(self, index: int) -> Camera:
        camera = self.source.camera(index)
        moved = np.column_stack([camera.rotation, self.scale * camera.translation])
        return replace(camera, world_to_camera=moved)

    def pose(self, index: int) -> Pose:
        pose = self.source.pose(index)
        return replace(pose, root_translation=self.scale * pose.root_translation + self.offset)

    def image(self, index: int) -> Float[Array, "H W 3"]:
        return self.source.image(index)

    def mask(self, index: int) -> Float[Array, "H W"]:
        return self.source.mask(index)


def _bone_lengths(skeleton: Skeleton) -> Float[Array, "B"]:
    rest = skeleton.rest_joints
    bones = [
        rest[child] - rest[above] for child, above in enumerate(skeleton.parents) if above >= 0
    ]
    return np.linalg.norm(bones, axis=1)
