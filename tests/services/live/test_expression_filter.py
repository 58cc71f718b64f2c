"""Faces and hands of who is driven live: quick enough, steady enough, never a jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from capture.body.expressions import FACE, LEFT_HAND, RIGHT_HAND, ObservedExpression
from scene.expression import EXPRESSION_NAMES, neutral
from services.live.motion.expression_filter import EASE_S, HELD_S, ExpressionFilter
from services.live.motion.live_motion import LiveMotion
from tests.capture.people import body, standing
from tests.services.live.people import seen

JAW, BLINK, INDEX = (
    EXPRESSION_NAMES.index(n) for n in ("jaw_open", "blink_left", "left_index_curl")
)
FRAME_S = 1.0 / 30.0


def expression(known: int = FACE, **values: float) -> ObservedExpression:
    numbers = np.array([values.get(name, 0.0) for name in EXPRESSION_NAMES])
    return ObservedExpression(numbers, known)


def shown(filter_: ExpressionFilter, given: list[ObservedExpression]) -> np.ndarray:
    """What is shown when each of `given` has come, a frame apart."""
    times = FRAME_S * np.arange(len(given))
    return np.array([filter_.update(one, t).at(t) for one, t in zip(given, times, strict=True)])


def test_a_blink_of_a_tenth_of_a_second_is_seen():
    given = [expression(blink_left=float(6 <= frame < 9)) for frame in range(20)]
    lids = shown(ExpressionFilter(), given)[:, BLINK]
    assert lids.max() > 0.8
    assert lids[5] == 0.0
    assert lids[14] < 0.1


def test_what_trembles_is_stilled():
    random = np.random.default_rng(0)
    given = [expression(jaw_open=0.4 + 0.03 * random.standard_normal()) for _ in range(90)]
    came = np.array([one.values[JAW] for one in given])[30:]
    assert shown(ExpressionFilter(), given)[30:, JAW].std() < 0.7 * came.std()


def test_what_is_no_longer_seen_stands_a_moment_then_rests_and_comes_back_without_a_jump():
    live = ExpressionFilter()
    shown(live, [expression(jaw_open=1.0)] * 30)
    last_s = 29 * FRAME_S
    held = live.update(None, last_s + FRAME_S)
    assert held.at(last_s + HELD_S)[JAW] > 0.95
    gone = [held.at(last_s + HELD_S + share * EASE_S)[JAW] for share in (0.0, 0.3, 0.6, 1.0)]
    assert gone == sorted(gone, reverse=True)
    assert gone[-1] == 0.0
    half_s = last_s + HELD_S + 0.5 * EASE_S
    back = live.update(expression(jaw_open=1.0), half_s)
    assert held.at(half_s)[JAW] < back.at(half_s)[JAW] < 0.8


def test_a_hand_that_is_seen_keeps_no_face_awake():
    live = ExpressionFilter()
    live.update(expression(FACE | LEFT_HAND, jaw_open=1.0, left_index_curl=1.0), 0.0)
    for frame in range(1, 60):
        now = live.update(expression(LEFT_HAND, left_index_curl=1.0), frame * FRAME_S)
    assert now.at(59 * FRAME_S)[JAW] == 0.0
    assert now.at(59 * FRAME_S)[INDEX] > 0.95


def test_a_performer_driven_live_does_what_their_packets_say_and_rests_when_they_are_gone():
    live, motion = LiveMotion(body().skeleton), standing(30)
    grinning = expression(FACE | RIGHT_HAND, smile=0.8, right_little_curl=0.5)
    for number in range(len(motion)):
        pose = motion.pose(number)
        live.update(replace(seen(pose, number), expression=grinning), pose.time_s)
    end_s = float(motion.times_s[-1])
    pose, later = live.pose_at(end_s), live.pose_at(end_s + 5.0)
    assert pose is not None
    assert later is not None
    np.testing.assert_allclose(pose.expression, grinning.values, atol=0.02)
    np.testing.assert_array_equal(later.expression, neutral())
