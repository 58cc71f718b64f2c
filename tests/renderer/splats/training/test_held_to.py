"""A model that goes on learning must show what it knew as well as before."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import ForgotTooMuch, TrainingStopped
from renderer.splats.model import SplatModel
from renderer.splats.training.held_to import held_out_frames
from renderer.training import train
from scene.sequence import Sequence
from tests.renderer.clocks import ticking
from tests.renderer.studio import make_sequence

KNOWN = 24


@pytest.fixture(scope="module")
def clip() -> Sequence:
    return make_sequence(frames=KNOWN)


@pytest.fixture(scope="module")
def before(clip) -> SplatModel:
    model = train(clip, iterations=150, clock=ticking()).splats
    assert model is not None
    return model


class _Painted:
    """Frames in which the person is of another colour (a `FrameSource`)."""

    def __init__(self, sequence: Sequence) -> None:
        self._source = sequence.train

    def __len__(self) -> int:
        return len(self._source)

    def camera(self, index):
        return self._source.camera(index)

    def pose(self, index):
        return self._source.pose(index)

    def mask(self, index):
        return self._source.mask(index)

    def image(self, index):
        return (self.mask(index)[..., None] * [0.9, 0.1, 0.9]).astype(np.float32)


def test_one_that_stays_as_good_says_how_good_it_is(clip, before):
    both = clip.followed_by(replace(clip, data_hash="again"))
    model = train(both, iterations=60, start=before, held_to=KNOWN, clock=ticking())
    lost = model.metrics["held_to"]
    assert lost["lost_db"]["body"] <= 0.5
    json.dumps(lost)


def test_one_that_forgets_is_refused_and_told_why(clip, before):
    other = replace(clip, train=_Painted(clip), data_hash="other colours")
    both = clip.followed_by(other).followed_by(other).followed_by(other)
    with pytest.raises(ForgotTooMuch, match=r"got errors of body \+.* on 3 frames of the clip"):
        train(both, iterations=100, start=before, held_to=KNOWN, clock=ticking())


def test_a_training_that_was_stopped_is_held_to_the_same(clip, before, tmp_path):
    other = replace(clip, train=_Painted(clip), data_hash="other colours")
    both = clip.followed_by(other).followed_by(other).followed_by(other)
    checkpoint, asked = tmp_path / "checkpoint", iter([False] * 2 + [True] * 1000)

    def run(should_stop):
        return train(
            both,
            iterations=100,
            start=before,
            held_to=KNOWN,
            checkpoint=checkpoint,
            should_stop=should_stop,
            clock=ticking(),
        )

    with pytest.raises(TrainingStopped):
        run(lambda: next(asked))
    with pytest.raises(ForgotTooMuch):
        run(lambda: False)
    assert len(held_out_frames(KNOWN)) == 3


def test_held_out_frames_are_few_and_lie_evenly():
    assert held_out_frames(19) == ()
    assert held_out_frames(20) == (5, 15)
    many = held_out_frames(400)
    assert len(many) == 8
    assert set(np.diff(many)) == {50}
