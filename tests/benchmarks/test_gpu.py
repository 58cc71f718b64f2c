"""The GPU's benchmark where there may be none, and the page that shows its figures."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.gpu import run, tables
from renderer.devices import best_device


def test_the_page_shows_the_figures():
    figures = json.loads(Path("docs/figures/gpu.json").read_text())
    made = tables(figures)
    assert made in Path("docs/gpu.md").read_text()
    assert len([line for line in made.splitlines() if line.startswith("| 1 x 10,000")]) == 3


def test_without_a_gpu_it_says_so(tmp_path):
    if best_device().type != "cpu":
        return
    run(tmp_path / "gpu.json", None, [])
    report = json.loads((tmp_path / "gpu.json").read_text())
    assert report["missing"] == "no CUDA device"
    assert "splats" not in report
