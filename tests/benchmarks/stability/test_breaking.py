"""Where an axis breaks."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.stability.breaking import (
    Reach,
    breaking_points,
    is_broken,
    is_unusable,
)
from benchmarks.stability.measure import AXES

NOISE = AXES["sensor_noise"]


def row(step: float, psnr: float, lpips: float | None = 0.02, **more: Any) -> dict[str, Any]:
    about = {"axis": NOISE.name, "subject": "somebody", "method": "splats"}
    told = {"outcome": "measured", "psnr": psnr, "lpips": lpips}
    return {**about, "step": step, "label": NOISE.label(step), **told, **more}


@pytest.mark.parametrize(
    ("psnr", "lpips", "broken", "unusable"),
    [
        (31.0, 0.02, False, False),
        (30.5, 0.02, False, False),
        (29.9, 0.02, True, False),
        (33.0, 0.031, True, False),
        (33.0, None, False, False),
        (23.9, 0.02, True, True),
        (33.0, 0.26, True, True),
    ],
)
def test_a_step_breaks_by_loss_or_where_it_is_no_use(psnr, lpips, broken, unusable):
    assert is_broken(NOISE, row(8.0, psnr, lpips), row(0.0, 33.0)) is broken
    assert is_unusable(NOISE, row(8.0, psnr, lpips)) is unusable


@pytest.mark.parametrize("outcome", ["refused", "failed"])
def test_no_picture_is_broken(outcome: str):
    assert is_broken(NOISE, {**row(8.0, 0.0), "outcome": outcome}, row(0.0, 33.0))


def test_motion_has_no_floor():
    late = row(0.5, 20.0)
    assert not is_broken(AXES["silence"], late, row(0.0, 22.0))
    assert is_broken(AXES["silence"], late, row(0.0, 24.0))


def reaches(*rows: dict[str, Any]) -> tuple[Reach, Reach]:
    (point,) = breaking_points(AXES, rows)
    return point.broken, point.unusable


def test_an_axis_holds_to_the_step_before_the_first_broken_one():
    found = reaches(row(0.0, 33.0), row(8.0, 29.0), row(64.0, 20.0))
    assert found == (Reach("0", "8", 0.0), Reach("8", "64", 0.4))


def test_an_axis_may_hold_throughout_or_not_at_all():
    assert reaches(row(0.0, 33.0), row(64.0, 31.0)) == (Reach("64", None, 1.0),) * 2
    never = Reach(None, "0", 0.0)
    assert reaches(row(0.0, 33.0, 0.3), row(64.0, 20.0)) == (Reach("0", "64", 0.0), never)


def test_who_is_no_use_undisturbed_breaks_by_what_is_lost():
    never = Reach(None, "0", 0.0)
    assert reaches(row(0.0, 20.0), row(64.0, 19.0)) == (Reach("64", None, 1.0), never)
    assert reaches(row(0.0, 20.0), row(64.0, 16.0)) == (Reach("0", "64", 0.0), never)


def test_rows_are_grouped_and_put_in_order():
    mixed = [row(64.0, 20.0), row(0.0, 33.0), {**row(64.0, 33.0), "subject": "no start"}]
    alone = {**row(0.0, 33.0), "subject": "undisturbed alone"}
    unknown = {**row(0.0, 33.0), "axis": "of another day"}
    (point,) = breaking_points(AXES, [*mixed, alone, unknown])
    assert (point.subject, point.broken.at) == ("somebody", "64")
