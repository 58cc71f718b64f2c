"""Losses that outliers do not rule."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from capture.fitting.robust import geman_mcclure, pseudo_huber
from scene.arrays import Tensor

SQUARED = st.floats(0.0, 1e8)
WIDTHS = st.floats(0.5, 20.0)


def of(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)


def slope(loss: Tensor, by: Tensor) -> float:
    return torch.autograd.grad(loss, by)[0].item()


@given(SQUARED, WIDTHS)
def test_no_residual_costs_more_than_its_square(squared, width):
    above = squared * (1.0 + 1e-12) + 1e-12
    assert 0.0 <= pseudo_huber(of(squared)).item() <= above
    assert 0.0 <= geman_mcclure(of(squared), width).item() <= above


@given(SQUARED, SQUARED, WIDTHS)
def test_a_larger_residual_never_costs_less(one, other, width):
    less, more = sorted((one, other))
    assert pseudo_huber(of(less)) <= pseudo_huber(of(more))
    assert geman_mcclure(of(less), width) <= geman_mcclure(of(more), width) * (1.0 + 1e-12)


@given(st.floats(0.0, 1e-3), WIDTHS)
def test_small_residuals_cost_their_square(squared, width):
    assert pseudo_huber(of(squared)).item() == pytest.approx(squared, rel=1e-3, abs=1e-12)
    assert geman_mcclure(of(squared), width).item() == pytest.approx(squared, rel=5e-3)


@given(st.floats(30.0, 1e4))
def test_far_residuals_pull_alike_under_pseudo_huber(residual):
    value = of(residual).requires_grad_()
    assert slope(pseudo_huber(value**2), value) == pytest.approx(2.0, rel=1e-3)


@given(WIDTHS)
def test_far_residuals_hardly_pull_under_geman_mcclure(width):
    at_width, far = of(width).requires_grad_(), of(30.0 * width).requires_grad_()
    assert geman_mcclure(at_width**2, width).item() == pytest.approx(0.5 * width**2)
    assert geman_mcclure(far**2, width).item() < width**2
    pull = slope(geman_mcclure(far**2, width), far)
    assert 0.0 < pull < 1e-3 * slope(geman_mcclure(at_width**2, width), at_width)


def test_both_have_a_gradient_at_zero():
    for loss in (pseudo_huber, lambda squared: geman_mcclure(squared, 3.0)):
        squared = of(0.0).requires_grad_()
        assert slope(loss(squared), squared) == pytest.approx(1.0)
