"""What the fit is given: landmarks that are missing for a moment."""

from __future__ import annotations

import numpy as np
import pytest

from capture.body.landmark_names import LANDMARK_COUNT
from capture.detection.landmark_arrays import (
    LONGEST_GAP_S,
    hidden_for_long,
    hidden_joints,
    interpolate_gaps,
    person_height_px,
)
from capture.detection.landmarks import Landmarks
from scene.arrays import Array
from tests.capture.people import JOINT, LANDMARK

LOST = 15
TIMES_S = np.array([0.0, 0.1, 0.15, 0.3, 0.4, 0.5])


def moving(seen: list[bool]) -> list[Landmarks]:
    """All landmarks move evenly, as far as the landmark `LOST` is `seen`."""
    people = []
    for time_s, there in zip(TIMES_S, seen, strict=True):
        pixels = np.full((LANDMARK_COUNT, 2), 100.0 + 200.0 * time_s)
        world = np.full((LANDMARK_COUNT, 3), -0.5 * time_s)
        visibility = np.full(LANDMARK_COUNT, 0.8)
        if not there:
            pixels[LOST], world[LOST], visibility[LOST] = 7.0, 7.0, 0.0
        people.append(Landmarks(pixels, world, visibility, np.zeros((8, 8), np.float32)))
    return people


def interpolated_at(
    seen: list[bool], takes: list[int] | None = None, longest_gap_s: float = LONGEST_GAP_S
) -> Array:
    """Frames [F] that have the landmark where it moved."""
    takes = takes or [0] * len(TIMES_S)
    pixels, world, visibility = interpolate_gaps(
        moving(seen), TIMES_S, np.array(takes), longest_gap_s
    )
    right = np.isclose(pixels[:, LOST], (100.0 + 200.0 * TIMES_S)[:, None]).all(1)
    right &= np.isclose(world[:, LOST], (-0.5 * TIMES_S)[:, None]).all(1)
    right &= np.isclose(visibility[:, LOST], 0.8)
    others = np.arange(LANDMARK_COUNT) != LOST
    np.testing.assert_array_equal(visibility[:, others], 0.8)
    return right


@pytest.mark.parametrize(
    ("seen", "right"),
    [
        ([True, False, False, True, True, True], [True] * 6),
        ([False, True, True, True, False, True], [False] + [True] * 5),
        ([True, True, True, True, False, False], [True] * 4 + [False] * 2),
        ([False] * 6, [False] * 6),
    ],
)
def test_a_missing_landmark_is_put_between_where_it_was_and_comes_back(seen, right):
    assert interpolated_at(seen).tolist() == right


def test_nothing_is_put_across_a_cut_nor_a_long_gap():
    seen = [True, False, False, True, True, True]
    assert interpolated_at(seen, [0, 0, 1, 1, 1, 1]).tolist() == seen
    assert interpolated_at(seen, longest_gap_s=0.29).tolist() == seen


def test_the_estimators_findings_are_left_as_they_are():
    people = moving([True, False, True, True, True, True])
    interpolate_gaps(people, TIMES_S, np.zeros(6, int))
    assert people[1].visibility[LOST] == 0.0
    assert (people[1].pixels[LOST] == 7.0).all()


def test_a_joint_is_hidden_when_nothing_beyond_it_is_seen():
    trust = np.ones((1, 33))
    trust[0, LANDMARK["left_ankle"]] = 0.0
    hidden = np.flatnonzero(hidden_joints(trust)[0])
    assert hidden.tolist() == [JOINT["left_knee"]]


def test_who_comes_close_for_long_hides_their_legs_and_who_blinks_out_does_not():
    times_s = np.arange(90) / 10.0
    takes = np.repeat([0, 1], 45)
    knee, hip = JOINT["left_knee"], JOINT["left_hip"]
    hidden = np.zeros((90, 24))
    hidden[10:40, knee] = 1.0  # three seconds of the first take
    hidden[60:66, hip] = 1.0  # a moment of the second
    lasting = hidden_for_long(hidden, times_s, takes)
    assert not lasting[:, hip].any()
    assert (lasting[20:30, knee] == 1.0).all()
    assert not lasting[:8, knee].any()
    assert not lasting[45:, knee].any()


def test_a_recording_that_never_shows_a_joint_hides_it_in_that_recording_alone():
    takes = np.repeat([0, 1], 6)
    hidden = np.zeros((12, 24))
    hidden[takes == 1, JOINT["left_knee"]] = 1.0
    lasting = hidden_for_long(hidden, np.arange(12) / 10.0, takes)
    assert lasting[:, JOINT["left_knee"]].tolist() == takes.tolist()


def test_a_persons_size_is_that_of_their_own_recording_and_a_bow_changes_nothing():
    takes = np.repeat([0, 1], 20)
    pixels = np.zeros((40, 33, 2))
    trunk_px = np.where(takes == 0, 300.0, 60.0)
    trunk_px[25:29] = 20.0  # bowing towards the camera
    pixels[:, [LANDMARK["left_hip"], LANDMARK["right_hip"]], 1] = trunk_px[:, None]
    heights = person_height_px(pixels, np.arange(40) / 10.0, takes)
    np.testing.assert_allclose(heights[takes == 0], 3.4 * 300.0)
    np.testing.assert_allclose(heights[takes == 1], 3.4 * 60.0)
