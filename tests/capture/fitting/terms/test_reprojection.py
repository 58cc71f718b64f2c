"""The reprojection error: landmarks of the body on those of the picture."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.fitting.observations import Observations
from capture.fitting.state import PosedClip
from capture.fitting.terms.reprojection import DEVIATION, ReprojectionError
from tests.capture.fitting.known_clips import (
    FRAMES,
    PERSON_PX,
    assert_gradients_are_slopes,
    disturbed,
    double_precision,
    energy_of,
    gradients_of,
    known_body,
    known_state,
    seen_of,
)
from tests.capture.people import LANDMARK

STATE = known_state()
KNEE = LANDMARK["left_knee"]


def seen_off(off_px: tuple[float, float], frames: slice = slice(None)) -> Observations:
    """A left knee that is seen `off_px` from where it is."""
    seen = seen_of(STATE)
    seen.landmarks_px[frames, KNEE] += torch.tensor(off_px)
    return seen


def once_pictures_are_looked_at(seen: Observations) -> float:
    with double_precision():
        clip, term = PosedClip(STATE, known_body(), seen), ReprojectionError(known_body(), seen)
        term.prepare(clip, coarse=True)
        return term.energy(clip).item()


def test_landmarks_where_they_are_seen_cost_nothing():
    assert energy_of(ReprojectionError, STATE, seen_of(STATE)) == 0.0
    assert once_pictures_are_looked_at(seen_of(STATE)) == 0.0


@settings(max_examples=20)
@given(deviations=st.floats(0.0, 100.0), direction=st.floats(0.0, 2.0 * np.pi))
def test_energy_grows_with_the_distance_alike_in_all_directions(deviations, direction):
    off_px = deviations * DEVIATION * PERSON_PX
    seen = seen_off((off_px * np.cos(direction), off_px * np.sin(direction)))
    expected = 2.0 * (np.sqrt(1.0 + deviations**2) - 1.0)
    assert energy_of(ReprojectionError, STATE, seen) == pytest.approx(expected, abs=1e-4)


def test_a_larger_person_may_be_off_by_more_pixels():
    near = seen_of(STATE, person_px=torch.full((FRAMES,), 2.0 * PERSON_PX))
    near.landmarks_px[:, KNEE, 0] += 20.0
    assert energy_of(ReprojectionError, STATE, near) == pytest.approx(
        energy_of(ReprojectionError, STATE, seen_off((10.0, 0.0)))
    )


def test_one_frame_counts_as_its_share_of_the_clip():
    whole = energy_of(ReprojectionError, STATE, seen_off((10.0, 0.0)))
    one = energy_of(ReprojectionError, STATE, seen_off((10.0, 0.0), slice(1)))
    assert one == pytest.approx(whole / FRAMES)


def test_outliers_have_no_say_once_pictures_have_one():
    px = DEVIATION * PERSON_PX
    near, far, farther = (
        [once_pictures_are_looked_at(seen_off((n * px + more, 0.0))) for more in (0.0, 1.0)]
        for n in (1.0, 30.0, 100.0)
    )
    pull = near[1] - near[0]
    assert 0.0 < far[1] - far[0] < 0.01 * pull
    assert 0.0 < farther[1] - farther[0] < 1e-4 * pull


def test_an_unseen_landmark_has_no_pull_wherever_it_is_guessed():
    hidden = seen_off((1e4, -1e4))
    hidden.landmark_weights[:, KNEE] = 0.0
    assert energy_of(ReprojectionError, STATE, hidden) == 0.0
    assert not any(pull.any() for pull in gradients_of(ReprojectionError, STATE, hidden).values())


def test_energy_is_shared_out_by_weights_and_by_trust_in_frames():
    seen = seen_off((10.0, 0.0))
    whole = energy_of(ReprojectionError, STATE, seen)
    seen.landmark_weights[:, KNEE] = 0.25
    assert energy_of(ReprojectionError, STATE, seen) == pytest.approx(0.25 * whole)
    distrusted = known_state()
    distrusted.frame_confidence[:] = 0.1
    assert energy_of(ReprojectionError, distrusted, seen) == pytest.approx(0.025 * whole)


def test_gradients_are_slopes():
    assert_gradients_are_slopes(ReprojectionError, disturbed(STATE), seen_of(STATE))
