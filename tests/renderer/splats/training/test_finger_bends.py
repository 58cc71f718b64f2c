"""Fingers of a clip bend as its pictures show, and no further than these tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.splats.expressions import ClipBlendShapes
from renderer.splats.layout import PARAMETERS, POSITION
from renderer.splats.training.finger_bends import FingerBends
from scene.expression import BLEND_SHAPE_COUNT, CURLS, EXPRESSION_COUNT
from scene.sequence import Sequence
from tests.renderer.studio import make_model, make_sequence

PLACE = slice(POSITION, POSITION + 3)
INDEX, MIDDLE = CURLS.start + 1, CURLS.start + 2


def clip(curl: float = 0.3) -> Sequence:
    """All fingers are captured as bent by `curl`."""
    made = make_sequence(frames=6)
    expressions = np.zeros((len(made.motion), EXPRESSION_COUNT))
    expressions[:, CURLS] = curl
    return replace(made, motion=replace(made.motion, expressions=expressions))


def shapes(bends: FingerBends) -> ClipBlendShapes:
    """Ten splats, of which four are of the index finger and of a face."""
    offsets = np.zeros((4, BLEND_SHAPE_COUNT, 3), np.float32)
    offsets[:, (0, INDEX, EXPRESSION_COUNT + INDEX - CURLS.start)] = np.random.default_rng(
        3
    ).uniform(-0.05, 0.05, (4, 3, 3))
    return ClipBlendShapes(np.array([1, 4, 5, 8], np.int32), offsets, bends.expressions)


def splats() -> np.ndarray:
    return np.random.default_rng(1).uniform(size=(10, PARAMETERS)).astype(np.float32)


def test_the_gradient_by_curls_is_that_of_finite_differences():
    bends = FingerBends(clip())
    one, parameters = shapes(bends), splats()
    gradient = np.random.default_rng(2).normal(size=parameters.shape).astype(np.float32)

    def loss(step: float, number: int) -> float:
        bends.expressions[2, number] += step
        moved = one.moved(parameters, 2).astype(np.float64)
        bends.expressions[2, number] -= step
        return float((moved[:, PLACE] * gradient[:, PLACE]).sum())

    found = one.by_curls(gradient, 2)
    for number in (INDEX, MIDDLE):
        expected = (loss(1e-2, number) - loss(-1e-2, number)) / 2e-2
        assert found[number - CURLS.start] == pytest.approx(expected, abs=1e-4)


def learnt(
    bends: FingerBends, bent: float, frames: range = range(6), fraction: float = 1.0
) -> np.ndarray:
    """The index finger's curls after forty looks at each of `frames`, which show it `bent`; that of
    the first splat says how far."""
    one, parameters = shapes(bends), splats()
    for _ in range(40):
        for frame in frames:
            true = replace(one, expressions=bends.expressions.copy())
            true.expressions[frame, INDEX] = bent
            gradient = np.zeros_like(parameters)
            gradient[:, PLACE] = (one.moved(parameters, frame) - true.moved(parameters, frame))[
                :, PLACE
            ]
            bends.learn(frame, one, gradient, fraction)
    return bends.expressions[:, INDEX]


def test_fingers_bend_to_where_pictures_show_them_and_all_else_stays():
    bends = FingerBends(clip(0.3))
    assert learnt(bends, 0.7) == pytest.approx(0.7, abs=0.08)
    others = np.delete(bends.expressions, INDEX, axis=1)
    np.testing.assert_array_equal(others, np.delete(clip(0.3).motion.expressions, INDEX, axis=1))


def test_frames_that_are_not_looked_at_stay_as_captured_and_bends_are_from_nought_to_one():
    found = learnt(FingerBends(clip(0.9)), 1.5, range(3))
    assert found[:3].max() == 1.0
    assert found[4:] == pytest.approx(0.9)
    assert learnt(FingerBends(clip(0.3)), 0.7, fraction=0.1) == pytest.approx(0.3)


def test_a_checkpoint_and_an_earlier_model_of_the_clip_go_on_and_of_another_clip_do_not():
    made = clip()
    bends, again = FingerBends(made), FingerBends(made)
    learnt(bends, 0.7, range(3))
    again.restore(bends.state())
    np.testing.assert_array_equal(learnt(bends, 0.5), learnt(again, 0.5))
    motion = replace(made.motion, expressions=bends.expressions)
    earlier = replace(make_model(10), motion=motion, data_hash=made.data_hash)
    np.testing.assert_array_equal(FingerBends(made, earlier).expressions, bends.expressions)
    other = replace(earlier, data_hash="another")
    np.testing.assert_array_equal(FingerBends(made, other).expressions, made.motion.expressions)
