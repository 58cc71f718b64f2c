"""A mean that is learnt at once, then slowly."""

from __future__ import annotations

import numpy as np
import pytest

from services.live.settling_mean import SettlingMean

STEP_S = 1.0 / 30.0


def fed(mean: SettlingMean[float], value: float, seconds: float) -> float:
    for _ in range(round(seconds / STEP_S)):
        mean.add(value, STEP_S)
    return mean.value


def test_the_first_value_is_believed_whole():
    mean = SettlingMean(5.0)
    mean.add(2.0, STEP_S)
    assert mean.value == 2.0


@pytest.mark.parametrize(("known_s", "least", "most"), [(1.0, 0.4, 0.7), (60.0, 0.04, 0.06)])
def test_a_second_of_something_else_counts_less_the_more_is_known(known_s, least, most):
    mean = SettlingMean(0.0)
    fed(mean, 0.0, known_s)
    assert least < fed(mean, 1.0, 1.0) < most


def test_a_gap_longer_than_all_that_is_known_is_no_overshoot():
    mean = SettlingMean(np.zeros(3))
    mean.add(np.array([1.0, 0.0, 0.0]), STEP_S)
    mean.add(np.array([0.0, 1.0, 0.0]), 100.0)
    np.testing.assert_array_equal(mean.value, [0.0, 1.0, 0.0])
