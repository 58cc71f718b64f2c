"""Frames in which nobody was found teach nothing, and nobody at all is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import TrainingError
from renderer.person_frames import frames_with_person
from renderer.training import train
from scene import Sequence
from tests.renderer.studio import make_sequence


class Blanked:
    """A source in whose frames of `lost` nobody was found."""

    def __init__(self, source, lost: set[int]) -> None:
        self._source, self._lost = source, lost

    def __len__(self) -> int:
        return len(self._source)

    def camera(self, index: int):
        return self._source.camera(index)

    def pose(self, index: int):
        return self._source.pose(index)

    def image(self, index: int):
        return self._source.image(index) * float(index not in self._lost)

    def mask(self, index: int):
        return self._source.mask(index) * np.float32(index not in self._lost)


def losing(clip: Sequence, lost: set[int]) -> Sequence:
    return replace(clip, train=Blanked(clip.train, lost))


def test_frames_that_show_somebody_are_kept():
    assert frames_with_person([True, False, True]) == [0, 2]


@pytest.mark.parametrize("preset", ["splats", "fast"])
def test_a_clip_without_anybody_is_refused(preset: str):
    nobody = losing(make_sequence(), set(range(6)))
    with pytest.raises(TrainingError, match="one frame must show the person; got 6 frames"):
        train(nobody, preset=preset, iterations=1, clock=float)


def test_splats_learn_as_if_empty_frames_were_not_there():
    clip = make_sequence()
    models = [
        train(some, iterations=8, clock=float)
        for some in (losing(clip, {1, 4}), clip.part([0, 2, 3, 5]))
    ]
    first, other = (model.splats for model in models)
    assert first is not None
    assert other is not None
    np.testing.assert_array_equal(first.parameters, other.parameters)
    np.testing.assert_allclose(models[0].motion.times_s, [0.0, 0.2, 0.3, 0.5])
