"""The floor: what is under people's soles, and which way is up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from capture.body.model import load_body_model
from capture.detection.lifter import closed_form
from capture.fitting.observations import observe
from capture.fitting.state import FitBody, PosedClip, initial_state
from capture.fitting.terms.floor import (
    FloorContact,
    above,
    find_floor,
    floor_energy,
    floor_of,
    lean_energy,
    sole_vertices,
)
from scene.arrays import Array, Tensor
from scene.skeleton import JOINT_COUNT
from tests.capture.people import JOINT, body, camera, seen_by, standing

LEFT, RIGHT = slice(0, 4), slice(4, 8)
SHOWN = torch.ones(1, 8)


def test_soles_are_under_the_feet():
    model = load_body_model()
    chosen = sole_vertices(model)
    assert len(set(chosen.tolist())) == 8
    places = model.rest_vertices[chosen]
    assert places[:, 1].max() - model.rest_vertices[:, 1].min() < 0.02
    assert (places[LEFT, 0] > 0.0).all()
    assert (places[RIGHT, 0] < 0.0).all()
    heel, toes = places[[0, 4], 2], places[[1, 5], 2]
    assert (toes - heel > 0.15).all()


def standing_on(plane: Tensor, frames: int = 60) -> Tensor:
    """Soles [F 8 3] that wander over `plane`, one foot or none on it, a jump now and then."""
    rng = np.random.default_rng(0)
    points = np.zeros((frames, 8, 3))
    for frame in range(frames):
        step = rng.uniform(-0.6, 0.6, 2)
        for foot, lifted in ((LEFT, 0.0), (RIGHT, rng.uniform(0.0, 0.3))):
            x, z = step[0] + rng.uniform(-0.1, 0.1, 4), step[1] + rng.uniform(-0.12, 0.12, 4)
            jump = 0.3 if frame % 10 == 0 else 0.0
            points[frame, foot] = np.stack([x, np.full(4, lifted + jump), z], -1)
    a, b, c = plane.tolist()
    points[..., 1] += a * points[..., 0] + b * points[..., 2] + c
    return torch.tensor(points + rng.normal(0.0, 0.004, points.shape), dtype=torch.float32)


@pytest.mark.parametrize("slopes", [(0.0, -0.05), (-0.1, -0.25), (0.05, 0.1)])
def test_the_floor_is_found_under_steps_and_jumps(slopes):
    plane = torch.tensor([*slopes, -0.9])
    points = standing_on(plane)
    upright = plane[:2] + torch.tensor([0.05, -0.06])
    found = find_floor(points, torch.ones(len(points), 8), upright)
    np.testing.assert_allclose(found.numpy(), plane.numpy(), atol=0.03)
    found.requires_grad_()
    adam = torch.optim.Adam([found], lr=0.003)
    for _ in range(200):
        adam.zero_grad()
        heights = above(points, found)
        energy = floor_energy(heights, torch.ones_like(heights)) + lean_energy(found, upright)
        energy.backward()
        adam.step()
    np.testing.assert_allclose(found.detach().numpy(), plane.numpy(), atol=0.01)


def _pull(heights: list[float], shown: Tensor = SHOWN) -> Tensor:
    at = torch.tensor([heights], requires_grad=True)
    floor_energy(at, shown).backward()
    assert at.grad is not None
    return at.grad[0]


def test_the_lower_foot_is_drawn_to_the_floor_and_the_other_left_in_the_air():
    pull = _pull([0.01] * 4 + [0.03] * 4)
    assert (pull[LEFT] > 0.0).all()
    assert (pull[RIGHT] == 0.0).all()


def test_who_jumps_is_let_go_and_who_sinks_is_not():
    assert _pull([0.3] * 8).abs().max() < 0.02 * _pull([0.01] * 8)[0]
    assert (_pull([0.01] * 4 + [-0.03] * 4)[RIGHT] < 0.0).all()
    assert (_pull([-0.03] * 4 + [-0.03] * 4) < 0.0).all()


def test_feet_that_nothing_shows_are_not_drawn():
    hidden = torch.cat([torch.zeros(1, 4), torch.ones(1, 4)], 1)
    assert (_pull([-0.03] * 8, hidden)[LEFT] == 0.0).all()


def _floor_under(pitch_rad: float, shown: Tensor) -> tuple[Array | None, float]:
    """What is found under people at rest, 3 m before a camera that looks down, and its energy."""
    motion, view = standing(6), camera()
    people = [seen_by(view, body(), motion.pose(frame)) for frame in range(6)]
    masks = [person.mask for person in people]
    seen = observe(people, masks, motion.times_s, np.zeros(6, int), closed_form)
    model = FitBody(load_body_model())
    state = initial_state(model, seen)
    angles = np.zeros((6, JOINT_COUNT, 3))
    angles[:, 0, 0] = pitch_rad
    state.set_poses(np.arange(6), angles, np.tile([0.0, 0.0, -3.0], (6, 1)))
    term = FloorContact(model, replace(seen, shown=shown))
    assert floor_of(state) is None
    with torch.no_grad():
        term.prepare(PosedClip(state, model, seen), coarse=True)
    return floor_of(state), term.energy(PosedClip(state, model, seen)).item()


@pytest.mark.parametrize("pitch_rad", [0.0, 0.4])
def test_the_floor_is_where_people_stand_upright(pitch_rad):
    found, energy = _floor_under(pitch_rad, torch.ones(6, JOINT_COUNT))
    assert found is not None
    up = np.array([0.0, np.cos(pitch_rad), np.sin(pitch_rad)])
    np.testing.assert_allclose(found[:3], up, atol=0.06)
    pelvis_m = float(load_body_model().rest_joints[0, 1])
    assert abs(found[:3] @ (np.array([0.0, 0.0, -3.0]) - pelvis_m * up) - found[3]) < 0.02
    assert energy < 1.0


def test_there_is_no_floor_without_feet_nor_straight_from_above():
    shown = torch.ones(6, JOINT_COUNT)
    assert _floor_under(1.3, shown) == (None, 0.0)
    for part in ("ankle", "foot"):
        shown[:4, [JOINT[f"left_{part}"], JOINT[f"right_{part}"]]] = 0.0
    assert _floor_under(0.0, shown) == (None, 0.0)
