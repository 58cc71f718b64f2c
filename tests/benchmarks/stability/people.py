"""A subject of a few small frames, without files."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from benchmarks.stability.material import Material, Subject, frames_of
from tests.renderer.studio import make_sequence


def subject(frames: int = 12) -> Subject:
    """A coloured box of a body that turns round once, judged on its own frames."""
    clip = make_sequence(frames=frames)
    train = tuple(
        replace(frame, image=np.minimum(frame.image, frame.mask[..., None]))
        for frame in frames_of(clip.train, range(frames))
    )
    pairs = tuple(pairwise(train[:3]))
    material = Material(clip.body, clip.frames_per_second, train, train[::4], pairs, clip.motion)
    return Subject("a box", material)
