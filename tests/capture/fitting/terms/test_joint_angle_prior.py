"""The prior of everyday joint angles, frame by frame."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from capture.body.pose_prior import pose_prior
from capture.fitting.state import FitState
from capture.fitting.terms.joint_angle_prior import JointAnglePrior
from tests.capture.fitting.known_clips import (
    FRAMES,
    assert_gradients_are_slopes,
    disturbed,
    energy_of,
    gradients_of,
    known_state,
    seen_of,
)
from tests.capture.people import JOINT

PRIOR = pose_prior()
USUAL = replace(known_state(), joint_angles=PRIOR.mean.double().expand(FRAMES, 24, 3).clone())


def bent(joint: str, axis: int, rad: float, frames: slice = slice(None)) -> FitState:
    """The usual pose, with one joint `rad` away from it."""
    angles = USUAL.joint_angles.clone()
    angles[frames, JOINT[joint], axis] += rad
    return replace(USUAL, joint_angles=angles)


def test_the_usual_pose_costs_nothing():
    assert energy_of(JointAnglePrior, USUAL, seen_of(USUAL)) == 0.0


@pytest.mark.parametrize(
    ("joint", "axis", "deviation_rad"),
    [("head", 0, 0.3), ("left_shoulder", 1, 1.0), ("right_knee", 0, 1.5), ("right_hip", 1, 0.4)],
)
@pytest.mark.parametrize("deviations", [0.5, 1.0, 1.5])
def test_energy_is_squared_deviations_of_each_joint(joint, axis, deviation_rad, deviations):
    assert PRIOR.deviation[JOINT[joint], axis] == pytest.approx(deviation_rad)
    off = bent(joint, axis, deviations * deviation_rad)
    assert energy_of(JointAnglePrior, off, seen_of(off)) == pytest.approx(deviations**2, rel=1e-5)


def test_energy_is_a_mean_over_frames():
    one = bent("head", 0, 0.3, slice(1))
    assert energy_of(JointAnglePrior, one, seen_of(one)) == pytest.approx(1.0 / FRAMES, rel=1e-5)


def test_anybody_may_face_any_way():
    turned = bent("pelvis", 1, 3.0)
    assert energy_of(JointAnglePrior, turned, seen_of(turned)) == 0.0


def test_what_nothing_shows_is_held_at_rest():
    off = bent("left_hip", 0, 0.1)
    hidden = seen_of(off)
    hidden.hidden[:, JOINT["left_hip"]] = 1.0
    shown = energy_of(JointAnglePrior, off, seen_of(off))
    assert energy_of(JointAnglePrior, off, hidden) > 100.0 * shown
    pull = gradients_of(JointAnglePrior, off, hidden)["joint_angles"]
    assert (pull[:, JOINT["left_hip"], 0] > 0.0).all()


def test_a_knee_bends_one_way():
    forwards, backwards = (bent("left_knee", 0, rad) for rad in (0.3, -0.3))
    energies = [energy_of(JointAnglePrior, off, seen_of(off)) for off in (forwards, backwards)]
    assert energies[1] == pytest.approx(energies[0] + (0.3 / 0.05) ** 2)


def test_gradients_are_slopes():
    seen = seen_of(USUAL, hidden=torch.linspace(0.0, 1.0, 24).expand(FRAMES, 24).double())
    assert_gradients_are_slopes(JointAnglePrior, disturbed(known_state()), seen)
