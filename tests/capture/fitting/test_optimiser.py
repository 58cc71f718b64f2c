"""Steps of the fit: what is wrong for long is put right in few of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch

from capture.body.model import load_body_model
from capture.detection.lifter import closed_form
from capture.fitting.fit import ClipFit
from capture.fitting.observations import observe
from capture.fitting.optimiser import Adam, Descent, hierarchical_basis
from tests.capture.people import JOINT, body, camera, seen_by, standing

FRAMES, HIP = 30, JOINT["left_hip"]


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """As in the fit, whose tensors are small."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _fit(focal_px: float | None) -> ClipFit:
    motion = standing(FRAMES, frames_per_second=15.0)
    people = [seen_by(camera(), body(), motion.pose(frame)) for frame in range(len(motion))]
    masks = [person.mask for person in people]
    takes = np.zeros(FRAMES, int)
    seen = observe(people, masks, motion.times_s, takes, closed_form, focal_px=focal_px)
    return ClipFit(load_body_model(), seen)


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


def test_a_step_moves_whoever_is_close_a_shorter_way_than_whoever_is_far():
    fit = _fit(camera().focal_px)
    person_px = torch.where(torch.arange(FRAMES) < FRAMES // 2, 200.0, 1000.0)
    descent = Descent(fit.state, replace(fit.seen, person_px=person_px), 0.02)
    angles, pelvis = fit.state.joint_angles.detach().clone(), fit.state.pelvis.detach().clone()
    wrong = pelvis - torch.tensor([0.0, 0.0, 0.5])
    off = (fit.state.pelvis - wrong).square().sum() + fit.state.joint_angles.square().sum()
    descent.step(off, 0.0)
    moved = (fit.state.pelvis.detach() - pelvis).norm(dim=1)
    assert float(moved[0]) == pytest.approx(5.0 * float(moved[-1]), rel=0.1)
    turned = (fit.state.joint_angles.detach() - angles).norm(dim=(1, 2))
    assert float(turned[-1]) == pytest.approx(float(turned[0]), rel=0.2)


def test_an_error_of_seconds_is_left_sooner_than_frame_by_frame():
    fit = _fit(camera().focal_px)
    descent = Descent(fit.state, fit.seen, 0.02)
    for step in range(40):
        descent.step(fit.energy(pictures=False), step / 40)
    swing = 0.6 * torch.sin(torch.linspace(0.0, math.pi, FRAMES))
    left = {}
    for alone in (False, True):
        wrong = deepcopy(fit)
        with torch.no_grad():
            wrong.state.joint_angles[:, HIP, 0] += swing
        descent = Descent(wrong.state, wrong.seen, 0.01)
        if alone:
            for basis in descent.bases:
                basis[:, FRAMES:] = 0.0
        for step in range(25):
            descent.step(wrong.energy(pictures=False), step / 25)
        left[alone] = wrong.energy(pictures=False).item()
    assert left[False] < 0.5 * left[True]


@pytest.mark.parametrize("known", [True, False])
def test_a_known_focal_length_stays_as_it_is(known):
    fit = _fit(1.1 * camera().focal_px if known else None)
    before = fit.clip().focal_px.item()
    descent = Descent(fit.state, fit.seen, 0.02)
    for step in range(5):
        descent.step(fit.energy(pictures=False), step / 5)
    assert (fit.clip().focal_px.item() == before) == known


def test_steps_are_those_of_pytorchs_adam():
    def energy(unknowns: list[torch.Tensor], step: int) -> torch.Tensor:
        first, second = unknowns
        off = (first - 1.0).square().sum()
        return off if step < 3 else off + (second + first[0]).abs().pow(3).sum()

    found = []
    for theirs in (False, True):
        unknowns = [torch.zeros(4, requires_grad=True), torch.full((2,), 2.0, requires_grad=True)]
        rates = [0.1, 0.02]
        groups = list(zip(unknowns, rates, strict=True))
        adam = Adam(groups)
        twin = torch.optim.Adam(
            [{"params": [one], "lr": rate} for one, rate in groups], betas=(0.9, 0.99), eps=1e-5
        )
        for step in range(12):
            for one in unknowns:
                one.grad = None
            energy(unknowns, step).backward()
            share = 1.0 - step / 20
            for group, rate in zip(twin.param_groups, rates, strict=True):
                group["lr"] = share * rate
            twin.step() if theirs else adam.step(share)
        found.append(torch.cat(unknowns).detach())
    torch.testing.assert_close(*found)
