"""Frames in which nobody was found teach nothing, and fewer than two others are refused."""

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
@pytest.mark.parametrize("shown", [0, 1])
def test_a_clip_that_shows_nobody_or_one_picture_is_refused(preset: str, shown: int):
    clip = losing(make_sequence(), set(range(shown, 6)))
    said = rf"2 frames must show the person; got {shown} of 6, .*; look at the clip's masks, or"
    with pytest.raises(TrainingError, match=said):
        train(clip, preset=preset, iterations=1, clock=float)


def test_a_clip_of_a_single_frame_is_refused():
    with pytest.raises(TrainingError, match="2 frames must show the person; got 1 of 1"):
        train(make_sequence(frames=1), iterations=1, clock=float)


@pytest.mark.parametrize("preset", ["splats", "fast"])
def test_two_frames_are_enough(preset: str):
    two = losing(make_sequence(), {1, 2, 3, 4})
    assert train(two, preset=preset, iterations=1, clock=float).metrics["steps"] == 1


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
