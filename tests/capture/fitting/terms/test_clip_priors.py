"""Priors of what is the same in all frames of a clip."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from capture.fitting.state import FitState
from capture.fitting.terms.clip_priors import ClipPriors
from tests.capture.fitting.known_clips import (
    assert_gradients_are_slopes,
    disturbed,
    energy_of,
    gradients_of,
    known_state,
    seen_of,
)

STATE = known_state()
USUAL = replace(STATE, shape=torch.zeros_like(STATE.shape))
DEVIATIONS = [
    ("log_focal", (), 0.12, 0.5),
    ("clothing_m", (), 0.01, 0.5),
    ("lifter_bias", (15, 1), 0.25, 0.05),
    ("landmark_offsets", (7, 2), 0.01, 0.1),
    ("shape", (0,), 0.06, 0.5),
    ("shape", (3,), 0.2, 0.5),
]


def off(name: str, index: tuple[int, ...], by: float) -> FitState:
    """The usual state, with one number of `name` changed."""
    value = getattr(USUAL, name).clone()
    value[index] += by
    return replace(USUAL, **{name: value})


def test_the_usual_costs_nothing():
    assert energy_of(ClipPriors, USUAL, seen_of(USUAL)) == 0.0


def test_a_longer_clip_costs_the_same():
    longer = replace(known_state(9), shape=STATE.shape)
    assert energy_of(ClipPriors, longer, seen_of(longer)) == pytest.approx(
        energy_of(ClipPriors, STATE, seen_of(STATE))
    )


@pytest.mark.parametrize(("name", "index", "deviation", "weight"), DEVIATIONS)
@pytest.mark.parametrize("deviations", [-1.0, 0.5, 2.0])
def test_energy_is_squared_deviations_of_each_unknown(name, index, deviation, weight, deviations):
    state = off(name, index, deviations * deviation)
    assert energy_of(ClipPriors, state, seen_of(USUAL)) == pytest.approx(weight * deviations**2)
    pulls = gradients_of(ClipPriors, state, seen_of(USUAL))
    assert [other for other, pull in pulls.items() if pull.any()] == [name]


@pytest.mark.parametrize("number", [-0.6, 0.6])
def test_no_shape_is_far_beyond_the_body_models_own(number):
    gaussian = 0.5 * (number / 0.2) ** 2
    energy = energy_of(ClipPriors, off("shape", (1,), number), seen_of(USUAL))
    assert energy == pytest.approx(gaussian + (0.1 / 0.05) ** 2)


def test_gradients_are_slopes():
    assert_gradients_are_slopes(ClipPriors, disturbed(STATE), seen_of(STATE))
