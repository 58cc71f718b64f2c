"""Steps of the fit: what is wrong for long is put right in few of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import deepcopy

import numpy as np
import pytest
import torch

from capture.body.model import load_body_model
from capture.detection.lifter import closed_form
from capture.fitting.optimiser import Descent, hierarchical_basis
from capture.fitting.state import Problem
from tests.capture.people import JOINT, body, camera, seen_by, standing

FRAMES, HIP = 30, JOINT["left_hip"]


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """As in the fit, whose tensors are small."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _problem(focal_px: float | None) -> Problem:
    motion = standing(FRAMES, frames_per_second=15.0)
    people = [seen_by(camera(), body(), motion.pose(frame)) for frame in range(len(motion))]
    return Problem(
        people, [person.mask for person in people], motion.times_s, np.zeros(FRAMES, int),
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


def test_an_error_of_seconds_is_left_sooner_than_frame_by_frame():
    problem = _problem(camera().focal_px)
    descent = Descent(problem, 0.02)
    for step in range(40):
        descent.step(problem.energy(None), step / 40)
    swing = 0.6 * torch.sin(torch.linspace(0.0, math.pi, FRAMES))
    left = {}
    for alone in (False, True):
        wrong = deepcopy(problem)
        with torch.no_grad():
            wrong.angles[:, HIP, 0] += swing
        descent = Descent(wrong, 0.01)
        if alone:
            descent.basis[:, FRAMES:] = 0.0
        for step in range(25):
            descent.step(wrong.energy(None), step / 25)
        left[alone] = wrong.energy(None).item()
    assert left[False] < 0.5 * left[True]


@pytest.mark.parametrize("known", [True, False])
def test_a_known_focal_length_stays_as_it_is(known):
    problem = _problem(1.1 * camera().focal_px if known else None)
    before = problem.focal().item()
    descent = Descent(problem, 0.02)
    for step in range(5):
        descent.step(problem.energy(None), step / 5)
    assert (problem.focal().item() == before) == known
