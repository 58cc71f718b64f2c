"""Heads that follow their face's points, which come late and of some pictures alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.arrays import Array, Float
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_NAMES
from services.live.eye_level import head_in_room
from services.live.motion.head_following import HeadFollowing, ObservedHead

STEP_S = 1.0 / 30.0
NECK = JOINT_NAMES.index("neck")
UPPERMOST = [JOINT_NAMES.index(name) for name in ("spine3", "neck", "head")]
UPRIGHT = np.zeros((24, 3))


def about_y(rad: float) -> Float[Array, "3 3"]:
    return axis_angle_to_matrix(np.array([0.0, rad, 0.0]))


def head_of(angles: Float[Array, "24 3"]) -> Float[Array, "3 3"]:
    return head_in_room(axis_angle_to_matrix(angles))


def head_turn(angles: Float[Array, "24 3"]) -> float:
    return float(matrix_to_axis_angle(head_of(angles))[1])


def watched(following: HeadFollowing, from_s: float, to_s: float) -> None:
    """Somebody whose head is solved as looking ahead, picture by picture."""
    for time_s in np.arange(from_s, to_s - 1e-9, STEP_S):
        following.update(None, UPRIGHT, float(time_s))


@given(st.lists(st.floats(-0.5, 0.5), min_size=9, max_size=9))
def test_whatever_the_body_does_the_head_is_where_its_face_has_it(numbers):
    angles = UPRIGHT.copy()
    for joint, at in zip(UPPERMOST, (0, 3, 6), strict=True):
        angles[joint] = 0.5 * np.array(numbers[at : at + 3])
    seen = head_of(angles) @ axis_angle_to_matrix(np.array(numbers[:3]))
    following = HeadFollowing()
    following.update(ObservedHead(seen, 1.0), angles, 1.0)
    followed = following.followed(angles, 1.0)
    np.testing.assert_allclose(head_of(followed), seen, atol=1e-9)
    np.testing.assert_array_equal(followed[:NECK], angles[:NECK])


def test_a_first_head_is_taken_whole_though_it_was_seen_some_pictures_ago():
    following = HeadFollowing()
    watched(following, 0.0, 0.2)
    following.update(ObservedHead(about_y(0.4), 0.1), UPRIGHT, 0.2)
    followed = following.followed(UPRIGHT, 0.2)
    assert head_turn(followed) == pytest.approx(0.4)
    assert followed[NECK, 1] == pytest.approx(0.2)


def test_what_differs_is_come_to_without_a_jerk():
    following = HeadFollowing()
    following.update(ObservedHead(about_y(0.0), 0.0), UPRIGHT, 0.0)
    following.update(ObservedHead(about_y(0.4), STEP_S), UPRIGHT, STEP_S)
    assert 0.05 < head_turn(following.followed(UPRIGHT, STEP_S)) < 0.2
    watched(following, 2 * STEP_S, 0.7)
    assert head_turn(following.followed(UPRIGHT, 0.7)) == pytest.approx(0.4, abs=0.01)


def test_it_is_held_for_a_moment_where_no_face_is_seen_then_let_go():
    following = HeadFollowing()
    following.update(ObservedHead(about_y(0.4), 0.0), UPRIGHT, 0.0)
    watched(following, STEP_S, 4.0)
    turns = [head_turn(following.followed(UPRIGHT, time_s)) for time_s in (1.4, 2.0, 3.0)]
    assert turns == pytest.approx([0.4, 0.2, 0.0])


def test_no_head_is_followed_that_is_nowhere_near_or_of_no_known_picture():
    following = HeadFollowing()
    watched(following, 0.0, 3.0)
    following.update(ObservedHead(about_y(2.0), 2.9), UPRIGHT, 3.0)
    following.update(ObservedHead(about_y(0.4), 0.5), UPRIGHT, 3.1)
    assert following.followed(UPRIGHT, 3.1) is UPRIGHT
