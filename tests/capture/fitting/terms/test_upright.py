"""Upright people cost nothing, whatever the camera's pitch; leaning does, but a bow no more."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from capture.fitting.kinematics import rotation_matrices
from capture.fitting.observations import Observations
from capture.fitting.state import FitState
from capture.fitting.terms.upright import LEAN_RAD, LEANS, PITCH_RAD, SCENE_RAD, Upright
from scene.arrays import Tensor
from scene.skeleton import JOINT_NAMES
from tests.capture.fitting.known_clips import (
    FRAMES,
    assert_gradients_are_slopes,
    disturbed,
    double_precision,
    energy_of,
    known_state,
    seen_of,
)


def pitched(camera_rad: float, lean_rad: float = 0.0) -> FitState:
    """Somebody who leans by `lean_rad` before a camera that is pitched."""
    with double_precision():
        turn = rotation_matrices(torch.tensor([[-camera_rad + lean_rad, 0.0, 0.0]]))
        state = known_state(moves=False)
        return replace(
            state,
            shape=torch.zeros_like(state.shape),
            joint_angles=torch.zeros(FRAMES, 24, 3),
            root_rotations=turn.expand(FRAMES, 3, 3).clone(),
            tilt=torch.tensor([0.0, -camera_rad]).tan(),
        )


def vertical(camera_rad: float) -> Tensor:
    return pitched(camera_rad).up


def legless(state: FitState, camera_rad: float | None = None) -> Observations:
    """A clip that shows no legs, of a scene that shows how far its camera is pitched."""
    hidden = torch.zeros(FRAMES, 24, dtype=torch.float64)
    hidden[:, [JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]] = 1.0
    up = None if camera_rad is None else vertical(camera_rad)
    return seen_of(state, hidden=hidden, up=up)


def test_upright_people_cost_nothing_in_a_scene_that_shows_the_cameras_pitch():
    state = pitched(0.25)
    assert energy_of(Upright, state, legless(state, 0.25)) < 0.05


def test_a_lean_of_trunk_and_pelvis_costs_by_its_square_and_a_bow_hardly_more_than_a_lean():
    def cost(lean_rad: float) -> float:
        state = pitched(0.1, lean_rad)
        return energy_of(Upright, state, legless(state, 0.1))

    assert cost(LEAN_RAD) == pytest.approx(2.0, rel=0.15)
    assert cost(2.0 * LEANS * LEAN_RAD) < 2.0 * LEANS**2
    assert cost(1.2) - cost(1.0) < 0.5 * (cost(0.4) - cost(0.2))


def test_legs_that_are_seen_tell_themselves_how_far_somebody_leans():
    state = pitched(0.0, 0.3)
    assert energy_of(Upright, state, seen_of(state)) == pytest.approx(0.0, abs=1e-9)


def test_a_camera_is_level_unless_the_scene_says_otherwise():
    state = pitched(PITCH_RAD)
    assert energy_of(Upright, state, seen_of(state)) == pytest.approx(0.5, abs=0.05)
    scene = seen_of(state, up=vertical(PITCH_RAD + SCENE_RAD))
    assert energy_of(Upright, state, scene) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("scene", [True, False])
def test_gradients_are_slopes(scene):
    state = known_state()
    seen = legless(state, 0.2 if scene else None)
    assert_gradients_are_slopes(Upright, disturbed(state), seen)
