"""What the fit is told of a clip: trust in landmarks, times, and the unit of deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from capture.detection.landmarks import Landmarks
from capture.detection.lifter import closed_form
from capture.fitting.observations import USUAL_FOCAL, Observations, observe, time_steps
from tests.capture.people import JOINT, LANDMARK, body, camera, seen_by, standing

FRAMES = 4


@pytest.fixture(scope="module")
def people() -> list[Landmarks]:
    motion = standing(FRAMES)
    return [seen_by(camera(), body(), motion.pose(frame)) for frame in range(FRAMES)]


def observed(people: list[Landmarks], frames_per_second: float = 15.0) -> Observations:
    masks, times_s = [person.mask for person in people], np.arange(FRAMES) / frames_per_second
    return observe(people, masks, times_s, np.zeros(FRAMES, int), closed_form)


def test_steps_are_infinite_across_cuts_and_so_are_those_beside_them():
    steps_s, mid_steps_s = time_steps(
        np.array([0.0, 0.1, 0.3, 0.4, 0.6]), np.array([0, 0, 0, 1, 1])
    )
    np.testing.assert_allclose(steps_s, [0.1, 0.2, np.inf, 0.2], rtol=1e-6)
    np.testing.assert_allclose(mid_steps_s, [0.15, np.inf, np.inf], rtol=1e-6)


def test_nobody_believes_a_landmark_outside_the_picture_or_one_that_is_hidden(people):
    pixels, visibility = people[0].pixels.copy(), people[0].visibility.copy()
    pixels[LANDMARK["left_wrist"]] = [-1.0, 100.0]
    pixels[LANDMARK["right_wrist"]] = [100.0, camera().height + 1.0]
    visibility[LANDMARK["left_ankle"]] = 0.0
    seen = observed([replace(people[0], pixels=pixels, visibility=visibility), *people[1:]])
    names = ("left_wrist", "right_wrist", "left_ankle")
    assert not seen.landmark_weights[0, [LANDMARK[name] for name in names]].any()
    assert seen.landmark_weights[0, LANDMARK["left_elbow"]] == 1.0
    assert seen.landmark_weights[1, LANDMARK["left_wrist"]] == 1.0


def test_a_joint_is_hidden_that_nothing_ever_shows_and_with_it_what_hangs_on_it(people):
    blind = []
    for person in people:
        visibility = person.visibility.copy()
        visibility[LANDMARK["left_ankle"]] = 0.0
        blind.append(replace(person, visibility=visibility))
    seen = observed(blind)
    assert (seen.hidden[:, JOINT["left_knee"]] == 1.0).all()
    assert (seen.hidden[:, JOINT["right_knee"]] == 0.0).all()
    below = [JOINT[name] for name in ("left_knee", "left_ankle", "left_foot")]
    assert not seen.shown[:, below].any()
    assert seen.shown[:, JOINT["left_hip"]].all()


def test_the_estimators_axes_become_those_of_the_fit(people):
    seen = observed(people)
    np.testing.assert_allclose(seen.landmarks_m[0], people[0].world * [1.0, -1.0, -1.0], atol=1e-6)
    assert seen.landmarks_m[0, LANDMARK["nose"], 1] > seen.landmarks_m[0, LANDMARK["left_heel"], 1]


def test_a_camera_of_which_nothing_is_told_is_taken_for_a_usual_one(people):
    seen = observed(people)
    assert seen.focal_px == USUAL_FOCAL * 256
    assert not seen.focal_known
    assert seen.centre.tolist() == [128.0, 128.0]


@pytest.mark.parametrize(("rate", "factor"), [(5.0, 1.0), (15.0, 1.0), (30.0, 2.0), (60.0, 4.0)])
def test_deviations_of_speeds_grow_with_rates_above_the_usual(people, rate, factor):
    assert observed(people, rate).rate_factor == pytest.approx(factor)
