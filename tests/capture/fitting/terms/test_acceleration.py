"""Bodies have mass, at any frame rate, and cuts have none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.fitting.state import FitState
from capture.fitting.terms.acceleration import Acceleration, accelerations
from scene.arrays import Array
from tests.capture.fitting.known_clips import (
    FRAMES_PER_SECOND,
    assert_gradients_are_slopes,
    energy_of,
    gradients_of,
    known_state,
    seen_of,
    timing,
)

FRAMES, JOINTS = 6, 24
DEVIATION_M_S2 = 9.0
STILL = known_state(FRAMES, moves=False)
TIMES_S = np.arange(FRAMES) / FRAMES_PER_SECOND


def moved(path_m: Array) -> FitState:
    """Somebody who holds their pose while their pelvis goes along `path_m` [F 3]."""
    return replace(STILL, pelvis=STILL.pelvis + torch.from_numpy(path_m))


def at(times_s: Array, takes: Array | None = None) -> dict[str, Any]:
    """What observations say of the times of frames."""
    takes = np.zeros(len(times_s), int) if takes is None else takes
    steps_s, mid_steps_s = timing(times_s, takes)
    return {"times_s": times_s, "takes": takes, "steps_s": steps_s, "mid_steps_s": mid_steps_s}


def robust(deviations: float) -> float:
    return 2.0 * (np.sqrt(1.0 + deviations**2) - 1.0)


@settings(max_examples=15)
@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_who_stands_or_walks_steadily_costs_nothing(velocity):
    steady = moved(TIMES_S[:, None] * np.array(velocity))
    assert energy_of(Acceleration, steady, seen_of(steady)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("deviations", [0.1, 1.0, 5.0])
def test_energy_grows_with_the_acceleration_of_each_joint(deviations):
    falling = -0.5 * deviations * DEVIATION_M_S2 * TIMES_S**2
    state = moved(np.stack([0.0 * falling, falling, 0.0 * falling], 1))
    each = robust(deviations)
    assert energy_of(Acceleration, state, seen_of(state)) == pytest.approx(
        JOINTS * (FRAMES - 2) / FRAMES * each, rel=1e-5
    )


def test_acceleration_is_the_same_however_frames_are_spaced():
    times_s = np.array([0.0, 0.05, 0.2, 0.21, 0.4, 0.43])
    joints = torch.from_numpy(0.5 * 6.0 * times_s**2)[:, None, None] * torch.eye(3)[:1]
    energies = accelerations(joints, *timing(times_s, np.zeros(FRAMES, int)), 3.0)
    np.testing.assert_allclose(energies, robust(2.0), rtol=1e-4)


def test_deviations_grow_with_rates_above_the_usual():
    shape = np.sin(np.arange(FRAMES))[:, None] * np.array([0.01, 0.0, 0.0])
    slow, fast = TIMES_S, TIMES_S / 4.0
    usual = energy_of(Acceleration, moved(shape), seen_of(STILL, **at(slow)))
    # a quarter of the time makes sixteen times the acceleration, of which a quarter is left
    quick = energy_of(Acceleration, moved(shape / 4.0), seen_of(STILL, **at(fast)))
    assert quick == pytest.approx(usual, rel=1e-5)


def test_nothing_is_known_of_the_motion_across_a_cut():
    takes = np.array([0, 0, 0, 1, 1, 1])
    jump = moved(takes[:, None] * np.array([2.0, 0.0, 1.0]))
    cut = seen_of(jump, **at(TIMES_S, takes))
    assert energy_of(Acceleration, jump, seen_of(jump)) > 100.0
    assert energy_of(Acceleration, jump, cut) == 0.0
    assert not any(pull.any() for pull in gradients_of(Acceleration, jump, cut).values())


def test_two_frames_have_no_acceleration():
    few = known_state(2)
    assert energy_of(Acceleration, few, seen_of(few)) == 0.0


def test_gradients_are_slopes():
    state = known_state(FRAMES)
    cut = at(TIMES_S, np.array([0, 0, 0, 0, 1, 1]))
    assert_gradients_are_slopes(Acceleration, state, seen_of(state, **cut))
