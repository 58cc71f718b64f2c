"""Feet that stand do not slide, feet that swing are let go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from capture.fitting.state import FitState
from capture.fitting.terms.foot_sliding import FootSliding
from scene.skeleton import FOOT_JOINTS
from tests.capture.fitting.known_clips import (
    FRAMES,
    FRAMES_PER_SECOND,
    assert_gradients_are_slopes,
    energy_of,
    gradients_of,
    known_state,
    seen_of,
    timing,
)
from tests.capture.people import JOINT

DEVIATION_M_S = 0.2
STILL = known_state(moves=False)
EACH = len(FOOT_JOINTS) * (FRAMES - 1) / FRAMES
"""Pairs of frames of feet, a frame."""


def gliding(metres_a_second: float, frames_per_second: float = FRAMES_PER_SECOND) -> FitState:
    """Somebody who glides to their left without moving a joint."""
    path = torch.arange(FRAMES).double() / frames_per_second * metres_a_second
    return replace(STILL, pelvis=STILL.pelvis + path[:, None] * torch.tensor([1.0, 0.0, 0.0]))


def test_who_stands_costs_nothing_whatever_the_arms_do():
    waving = replace(STILL, joint_angles=STILL.joint_angles.clone())
    waving.joint_angles[:, JOINT["left_shoulder"]] += torch.linspace(-1.0, 1.0, FRAMES).double()[
        :, None
    ]
    assert energy_of(FootSliding, waving, seen_of(waving)) == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize("deviations", [0.1, 1.0, 3.0])
def test_energy_grows_with_the_speed_of_each_foot(deviations):
    state = gliding(deviations * DEVIATION_M_S)
    each = deviations**2 / (1.0 + deviations**2 / 3.0**2)
    assert energy_of(FootSliding, state, seen_of(state)) == pytest.approx(EACH * each, rel=1e-5)


def test_a_foot_that_swings_is_hardly_held():
    pulls = [
        gradients_of(FootSliding, state, seen_of(state))["pelvis"][-1, 0].item()
        for state in (gliding(DEVIATION_M_S), gliding(30.0 * DEVIATION_M_S))
    ]
    assert 0.0 < pulls[1] < 0.01 * pulls[0]


def test_speeds_may_be_higher_where_frames_are_closer_in_time():
    times_s = np.arange(FRAMES) / 60.0
    steps_s, mid_steps_s = timing(times_s, np.zeros(FRAMES, int))
    quick = gliding(4.0 * DEVIATION_M_S, 60.0)
    seen = seen_of(quick, times_s=times_s, steps_s=steps_s, mid_steps_s=mid_steps_s)
    state = gliding(DEVIATION_M_S)
    assert energy_of(FootSliding, quick, seen) == pytest.approx(
        energy_of(FootSliding, state, seen_of(state)), rel=1e-5
    )


def test_feet_may_stand_elsewhere_after_a_cut():
    takes = np.array([0, 0, 1, 1])
    jump = replace(STILL, pelvis=STILL.pelvis + 0.1 * torch.from_numpy(takes)[:, None])
    steps_s, mid_steps_s = timing(np.arange(FRAMES) / FRAMES_PER_SECOND, takes)
    cut = seen_of(jump, takes=takes, steps_s=steps_s, mid_steps_s=mid_steps_s)
    assert energy_of(FootSliding, jump, seen_of(jump)) > 1.0
    assert energy_of(FootSliding, jump, cut) == 0.0
    assert not any(pull.any() for pull in gradients_of(FootSliding, jump, cut).values())


def test_gradients_are_slopes():
    state = known_state()
    assert_gradients_are_slopes(FootSliding, state, seen_of(state))
