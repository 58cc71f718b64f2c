"""The estimator's 3D landmarks: their shape counts, their place and size do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.fitting.terms.landmarks_3d import DEVIATION_M, FACE_DEPTH_WEIGHT, Landmarks3D
from tests.capture.fitting.known_clips import (
    assert_gradients_are_slopes,
    disturbed,
    energy_of,
    gradients_of,
    known_state,
    seen_of,
)
from tests.capture.people import LANDMARK

STATE = known_state()
WRISTS = LANDMARK["left_wrist"], LANDMARK["right_wrist"]
EYES = LANDMARK["left_eye"], LANDMARK["right_eye"]


def energy_apart(pair: tuple[int, int], deviations: float) -> float:
    """Of a pair guessed off in depth, one nearer and one as much further, so that means stay."""
    seen = seen_of(STATE)
    for landmark, sign in zip(pair, (1.0, -1.0), strict=True):
        seen.landmarks_m[:, landmark, 2] += sign * deviations * DEVIATION_M
    return energy_of(Landmarks3D, STATE, seen)


@settings(max_examples=20)
@given(size=st.floats(0.5, 2.0), away=st.tuples(*[st.floats(-5.0, 5.0)] * 3))
def test_landmarks_of_any_size_at_any_place_cost_nothing(size, away):
    seen = seen_of(STATE)
    guess = size * seen.landmarks_m + torch.tensor(away, dtype=torch.float64)
    scaled = replace(STATE, log_landmark_scale=torch.tensor(-np.log(size)))
    energy = energy_of(Landmarks3D, scaled, replace(seen, landmarks_m=guess))
    assert energy == pytest.approx(0.0, abs=1e-12)


def test_a_size_that_is_not_the_persons_costs():
    larger = replace(STATE, log_landmark_scale=torch.tensor(0.1))
    assert energy_of(Landmarks3D, larger, seen_of(STATE)) > 1.0


@pytest.mark.parametrize("deviations", [0.1, 1.0, 10.0])
def test_energy_grows_with_the_distance(deviations):
    each = 2.0 * (np.sqrt(1.0 + deviations**2) - 1.0)
    assert energy_apart(WRISTS, deviations) == pytest.approx(2.0 * each)
    assert energy_apart(EYES, deviations) == pytest.approx(2.0 * FACE_DEPTH_WEIGHT * each)


def test_an_unseen_landmark_has_no_pull_nor_does_it_move_the_mean():
    hidden = seen_of(STATE)
    hidden.landmarks_m[:, WRISTS[0]] += 100.0
    hidden.landmark_weights[:, WRISTS[0]] = 0.0
    assert energy_of(Landmarks3D, STATE, hidden) == pytest.approx(0.0, abs=1e-12)
    for pull in gradients_of(Landmarks3D, STATE, hidden).values():
        np.testing.assert_allclose(pull, 0.0, atol=1e-10)


def test_a_frame_of_which_nothing_is_seen_costs_nothing():
    lost = seen_of(STATE)
    lost.landmarks_m[1] = 0.0
    lost.landmark_weights[1] = 0.0
    assert energy_of(Landmarks3D, STATE, lost) == pytest.approx(0.0, abs=1e-12)
    assert all(pull.isfinite().all() for pull in gradients_of(Landmarks3D, STATE, lost).values())


def test_frames_count_as_far_as_they_are_trusted():
    seen = seen_of(STATE)
    seen.landmarks_m[0, WRISTS[0]] += 0.1
    whole = energy_of(Landmarks3D, STATE, seen)
    distrusted = known_state()
    distrusted.frame_confidence[0] = 0.1
    assert energy_of(Landmarks3D, distrusted, seen) == pytest.approx(0.1 * whole)


def test_gradients_are_slopes():
    seen = seen_of(STATE)
    seen.landmark_weights[:, 20:] = 0.3
    assert_gradients_are_slopes(Landmarks3D, disturbed(STATE), seen)
