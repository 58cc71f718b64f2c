"""The table of every step compares like with like, and tells of trainings that were rolled back."""

from __future__ import annotations

from typing import Any

from benchmarks.pages.stability import stability
from benchmarks.stability.measure import AXES

ABOUT = {
    "commit": "abcdef0",
    "date": "2026-05-01T12:00:00+00:00",
    "uncommitted_changes": False,
    "machine": {"processor": "a processor"},
    "outcomes": {"measured": 1},
    "missing": 0,
    "frames": 60,
    "size": 192,
    "iterations": {"exact": 300, "refining": 600},
    "lpips": "squeeze",
    "region": "body crop",
}


def row(subject: str, step: float, psnr: float, **more: Any) -> dict[str, Any]:
    axis = AXES["sensor_noise"]
    about = {"axis": axis.name, "subject": subject, "method": "splats", "outcome": "measured"}
    return {**about, "step": step, "label": axis.label(step), "psnr": psnr, "lpips": 0.02, **more}


def table(*rows: dict[str, Any]) -> list[list[str]]:
    """Cells of the table of every step, its head first, without the rule under it."""
    text = stability({**ABOUT, "rows": rows}).split("### Every step")[1]
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in (lines[0], *lines[2:])]


def test_a_mean_is_of_the_same_people_at_every_step():
    _, *lines = table(
        *(row("painted", step, 35.0 - step) for step in (0.0, 4.0, 8.0)),
        *(row("lifelike", step, 33.0 - step) for step in (0.0, 4.0, 8.0)),
        *(row("loose clothes", step, 21.0 - step) for step in (0.0, 8.0)),
    )
    assert [cells[:4] for cells in lines] == [
        ["sensor noise, of 255 levels", "painted; lifelike", "0", "34.0 ± 1.0"],
        ["", "", "4", "30.0 ± 1.0"],
        ["", "", "8", "26.0 ± 1.0"],
        ["", "loose clothes", "0", "21.0"],
        ["", "", "8", "13.0"],
    ]


def test_rollbacks_are_told_of_where_there_are_any():
    quiet = [row("painted", 0.0, 35.0, rollbacks=0), row("painted", 8.0, 30.0)]
    assert "rolled back" not in table(*quiet)[0]
    rolled = row("lifelike", 8.0, 30.0, rollbacks=2, rollback_seconds=3.14)
    head, *lines = table(*quiet, row("lifelike", 0.0, 34.0), rolled)
    assert head[-1] == "rolled back"
    assert [cells[-1] for cells in lines] == ["", "2 times, 3.1 s"]


def test_refusals_say_whom_and_what_they_were_of():
    refused = row("painted", 64.0, 0.0, outcome="refused", why="TrainingError: no")
    text = stability({**ABOUT, "rows": [refused, {**refused, "method": "fast"}]})
    what = "sensor noise, of 255 levels, 64"
    assert f"- {what} (painted); {what} (painted, fast): *TrainingError: no*" in text
