"""When a training is good enough, read off its curve."""

from __future__ import annotations

from benchmarks.training_time import BUDGETS_S, curve, seconds_to


def test_time_to_an_accuracy_is_read_between_budgets():
    points = [(1.0, 30.0), (3.0, 32.0), (5.0, 34.0)]
    assert seconds_to(points, 33.0) == 4.0
    assert seconds_to(points, 29.0) == 1.0
    assert seconds_to(points, 35.0) is None


def test_a_curve_is_the_mean_over_performers():
    first, second = BUDGETS_S["warm"][:2]
    rows = [
        {"start": "warm", "budget_s": first, "psnr_novel_view_body_crop": 30.0},
        {"start": "warm", "budget_s": first, "psnr_novel_view_body_crop": 31.0},
        {"start": "cold", "budget_s": second, "psnr_novel_view_body_crop": 10.0},
    ]
    assert curve(rows, "warm") == [(first, 30.5)]
