"""The floor: what is under people's soles, and which way is up."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from capture.body import load_body_model
from capture.fit_floor import (
    Floor,
    above,
    find_floor,
    floor_energy,
    lean_energy,
    sole_vertices,
)
from capture.fit_terms import forward, rotation_matrices
from scene.arrays import Tensor
from scene.skeleton import JOINT_COUNT
from tests.capture.people import JOINT

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


def test_without_feet_there_is_no_floor():
    model = load_body_model()
    rest = torch.tensor(model.rest_joints, dtype=torch.float32)
    turns, pelvis = torch.zeros(5, JOINT_COUNT, 3), torch.tensor([[0.0, 0.0, -3.0]]).expand(5, 3)
    poses = forward(rotation_matrices(turns), pelvis, rest)
    shape = torch.zeros(model.shape_count)
    shown = torch.ones(5, JOINT_COUNT)
    floor = Floor(model, shown)
    assert floor.found() is None
    floor.find(*poses, rest, shape)
    found = floor.found()
    assert found is not None
    sole = -float(rest[0, 1])  # the pelvis is at the height of the camera
    np.testing.assert_allclose(found[:3], [0.0, 1.0, 0.0], atol=0.06)
    assert abs(found[:3] @ [0.0, sole, -3.0] - found[3]) < 0.02
    assert floor.energy(*poses, rest, shape).item() < 1.0
    for part in ("ankle", "foot"):
        shown[:, [JOINT[f"left_{part}"], JOINT[f"right_{part}"]]] = 0.0
    nowhere = Floor(model, shown)
    nowhere.find(*poses, rest, shape)
    assert nowhere.found() is None
    assert nowhere.energy(*poses, rest, shape).item() == 0.0
