"""Steps of the fit: what is wrong for long is put right in few of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from capture.body import load_body_model
from capture.fit_descent import Descent, hierarchical_basis
from capture.fit_problem import Problem
from capture.lifter import closed_form
from tests.capture.people import JOINT, body, camera, seen_by, standing

HIP = JOINT["left_hip"]


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """As in the fit, whose tensors are small."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _problem(focal_px: float | None) -> Problem:
    motion = standing(40, frames_per_second=15.0)
    people = [seen_by(camera(), body(), motion.pose(frame)) for frame in range(len(motion))]
    return Problem(
        people, [person.mask for person in people], motion.times_s, np.zeros(40, int),
        load_body_model(), focal_px, None, closed_form, None,
    )  # fmt: skip


def test_wide_hats_reach_every_frame_of_their_take_alike_and_none_of_another():
    times_s = np.arange(40) / 12.0
    takes = np.repeat([0, 1], [25, 15])
    basis = hierarchical_basis(times_s, takes).numpy()
    np.testing.assert_array_equal(basis[:, :40], np.eye(40))
    hats = basis[:, 40:]
    assert not ((hats[:25] > 0).any(axis=0) & (hats[25:] > 0).any(axis=0)).any()
    # narrow hats add up to one share everywhere, wide ones to another
    np.testing.assert_allclose(hats.sum(axis=1), hats.sum(axis=1)[0], rtol=1e-5)


def test_hats_are_as_wide_in_seconds_at_any_rate_of_frames():
    slow = hierarchical_basis(np.arange(31) / 15.0, np.zeros(31, int)).numpy()[:, 31:]
    fast = hierarchical_basis(np.arange(61) / 30.0, np.zeros(61, int)).numpy()[:, 61:]
    np.testing.assert_allclose(fast[::2], slow, atol=1e-5)


def _energy_after(steps: int, *, by_frames_alone: bool) -> float:
    """From a leg that swings wrongly over the whole clip."""
    problem = _problem(camera().focal_px)
    descent = Descent(problem, 0.02)
    for step in range(60):
        descent.step(problem.energy(None), step / 60)
    with torch.no_grad():
        problem.angles[:, HIP, 0] += 0.6 * torch.sin(torch.linspace(0.0, 3.14, 40))
    descent = Descent(problem, 0.01)
    if by_frames_alone:
        descent._basis[:, 40:] = 0.0
    for step in range(steps):
        descent.step(problem.energy(None), step / steps)
    return problem.energy(None).item()


def test_an_error_of_seconds_is_left_sooner_than_frame_by_frame():
    settled = _energy_after(100, by_frames_alone=False)
    whole = _energy_after(25, by_frames_alone=False)
    alone = _energy_after(25, by_frames_alone=True)
    assert whole - settled < 0.5 * (alone - settled)


@pytest.mark.parametrize("known", [True, False])
def test_a_known_focal_length_stays_as_it_is(known):
    problem = _problem(1.1 * camera().focal_px if known else None)
    before = float(problem.focal())
    descent = Descent(problem, 0.02)
    for step in range(5):
        descent.step(problem.energy(None), step / 5)
    assert (float(problem.focal()) == before) == known
