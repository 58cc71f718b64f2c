"""The lifter's poses, and what one person does otherwise all along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.fitting.state import FitState
from capture.fitting.terms.lifted_pose import LiftedPose
from scene.arrays import Tensor
from tests.capture.fitting.known_clips import (
    FRAMES,
    SPREAD_RAD,
    assert_gradients_are_slopes,
    disturbed,
    energy_of,
    gradients_of,
    known_state,
    seen_of,
)
from tests.capture.people import JOINT

STATE, REST = known_state(), known_state(moves=False)
REST.joint_angles[:] = 0.0
HEAD = JOINT["head"]


def nodding(rad: float) -> FitState:
    """A head `rad` lower than at rest in all frames."""
    angles = REST.joint_angles.clone()
    angles[:, HEAD, 0] = rad
    return replace(REST, joint_angles=angles)


def habit(rad: float) -> Tensor:
    """Holding the head `rad` lower than the lifter believes."""
    lifter_bias = torch.zeros(24, 3).double()
    lifter_bias[HEAD, 0] = rad
    return lifter_bias


def test_the_lifters_own_poses_cost_nothing():
    assert energy_of(LiftedPose, STATE, seen_of(STATE)) == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=20)
@given(st.floats(-np.pi, np.pi))
def test_energy_grows_with_the_angle_in_the_lifters_own_spread(rad):
    energy = energy_of(LiftedPose, nodding(rad), seen_of(REST))
    deviations = 2.0 * np.sin(0.5 * rad) / SPREAD_RAD  # the angle itself where that is small
    assert energy == pytest.approx(2.0 * (np.sqrt(1.0 + deviations**2) - 1.0), abs=1e-6)


def test_the_bodys_turn_counts_as_any_joints():
    turned = replace(REST, joint_angles=REST.joint_angles.clone())
    turned.joint_angles[:, 0, 1] = 0.2
    assert energy_of(LiftedPose, turned, seen_of(REST)) == pytest.approx(
        energy_of(LiftedPose, nodding(0.2), seen_of(REST))
    )


def test_who_is_believed_less_pulls_less():
    unsure = seen_of(REST)
    unsure.lifted_spread_rad[:, HEAD] = 2.0 * SPREAD_RAD
    half = energy_of(LiftedPose, nodding(0.02), unsure)
    assert half == pytest.approx(
        0.25 * energy_of(LiftedPose, nodding(0.02), seen_of(REST)), rel=0.01
    )


def test_a_habit_explains_what_is_otherwise_in_all_frames():
    used_to_it = replace(nodding(0.4), lifter_bias=habit(0.4))
    assert energy_of(LiftedPose, used_to_it, seen_of(REST)) == pytest.approx(0.0, abs=1e-9)
    assert energy_of(LiftedPose, replace(REST, lifter_bias=habit(0.4)), seen_of(REST)) > 0.5


def test_what_nothing_shows_has_no_pull():
    hidden = seen_of(REST)
    hidden.hidden[:, HEAD] = 1.0
    assert energy_of(LiftedPose, nodding(0.4), hidden) == pytest.approx(0.0, abs=1e-12)
    pull = gradients_of(LiftedPose, nodding(0.4), hidden)
    np.testing.assert_allclose(pull["joint_angles"][:, HEAD], 0.0, atol=1e-9)


def test_a_distrusted_frame_counts_less():
    distrusted = nodding(0.4)
    confidence = torch.tensor([0.1, *[1.0] * (FRAMES - 1)]).double()
    energy = energy_of(LiftedPose, replace(distrusted, frame_confidence=confidence), seen_of(REST))
    whole = energy_of(LiftedPose, distrusted, seen_of(REST))
    assert energy == pytest.approx(whole * (FRAMES - 0.9) / FRAMES)


def test_gradients_are_slopes():
    assert_gradients_are_slopes(LiftedPose, disturbed(STATE), seen_of(STATE))
