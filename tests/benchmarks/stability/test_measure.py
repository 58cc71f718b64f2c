"""A corner of the bench: curves fall as they should, nothing fails, and a cut run goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.pages.stability import finding, stability
from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import FigureWriter
from benchmarks.stability.charts import draw_charts
from benchmarks.stability.measure import AXES, QUICK, QUICK_AXES, run
from benchmarks.stability.subjects import SubjectSources
from tests.benchmarks.conftest import checkout as checkout

EFFORT = replace(QUICK, iterations=80, refining_iterations=160)
"""Poses are refined after six looks at each frame: of so few frames, that is soon."""


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("stability")
    return measured(folder, folder / "material")


def measured(root: Path, material: Path) -> dict[str, Any]:
    writer = FigureWriter.start("stability", checkout=Checkout(root), words=["bench"])
    return run(writer, SubjectSources(material, size_px=96, frames=12), EFFORT, "")


def curve(figures: dict[str, Any], axis: str) -> list[float]:
    rows = [r for r in figures["rows"] if (r["axis"], r["method"]) == (axis, "splats")]
    return [row["psnr"] for row in sorted(rows, key=lambda row: row["step"])]


def test_nothing_fails_and_every_step_has_figures(figures):
    assert figures["outcomes"].get("failed", 0) == 0
    assert {row["axis"] for row in figures["rows"]} == set(QUICK_AXES)


@pytest.mark.parametrize("axis", ["pose_noise", "sensor_noise", "silence"])
def test_more_disturbance_is_a_worse_picture(figures, axis: str):
    undisturbed, middle, worst = curve(figures, axis)
    assert undisturbed >= middle - 0.3
    assert middle > worst
    assert undisturbed > worst + 1.0


def test_refined_poses_are_worth_more_than_believed_ones(figures):
    by_method = {
        row["method"]: row for row in figures["rows"]
        if row["axis"] == "pose_noise" and row["step"] == 5.0
    }  # fmt: skip
    refined, believed = by_method["splats"], by_method["splats, poses believed"]
    assert refined["psnr"] > believed["psnr"] + 1.0
    assert refined["joint_mm"] < 0.8 * believed["joint_mm"]
    assert believed["joint_mm"] == pytest.approx(believed["joint_mm_given"])


def test_frames_without_anybody_are_told_apart_from_failures(figures):
    rows = {row["step"]: row for row in figures["rows"] if row["axis"] == "mask_lost"}
    assert rows[1.0]["outcome"] == "refused"
    assert "got" in rows[1.0]["why"]


def test_page_and_charts_show_what_was_measured(figures, tmp_path: Path):
    origin = {
        "commit": "abcdef0",
        "date": "2026-05-01T12:00:00+00:00",
        "uncommitted_changes": False,
        "machine": {"processor": "a processor"},
    }
    text = stability({**figures, **origin})
    assert "0 failures" in text
    assert all(AXES[name].words in text for name in QUICK_AXES)
    assert finding(figures).startswith("Of 4 axes 0 hold to their last step: none.")
    draw_charts(figures, tmp_path)
    kinds = [f"stability{part}.{kind}" for part in ("-curves", "") for kind in ("png", "svg")]
    assert sorted(path.name for path in tmp_path.iterdir()) == kinds


def test_what_is_measured_already_is_not_measured_again(figures, tmp_path_factory, capsys):
    root = tmp_path_factory.getbasetemp() / "stability0"
    again = measured(root, root / "material")
    assert again["rows"] == figures["rows"]
    assert (root / "build/figures/stability/worst.jpg").exists()
    assert "outcome" not in capsys.readouterr().out
