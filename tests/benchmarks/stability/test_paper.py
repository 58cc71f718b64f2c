"""The paper's field and splats, spoilt alike, each training in a process of its own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.pages.stability import paper_stability
from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import FigureWriter
from benchmarks.stability.paper import PaperEffort, run
from benchmarks.stability.subjects import SubjectSources
from tests.benchmarks.conftest import checkout as checkout

EFFORT = PaperEffort(20, 20, preset="fast", paper_iterations=5, steps=2, axes=("mask_dilated",))
"""Of the field that a processor trains."""


def test_both_methods_have_figures_undisturbed_and_spoilt_and_are_measured_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    writer = FigureWriter.start("paper-stability", checkout=Checkout(tmp_path), words=["bench"])
    inputs = SubjectSources(tmp_path / "material", size_px=96, frames=6)
    run(writer, inputs, "no device", EFFORT)
    figures = json.loads(writer.file.built.read_text())
    found = {(row["method"], row["label"]): row["outcome"] for row in figures["rows"]}
    assert found == {
        (method, label): "measured" for method in ("paper", "splats") for label in ("0 px", "8 px")
    }
    monkeypatch.setattr(
        "benchmarks.stability.paper.guarded", lambda _: pytest.fail("measured twice")
    )
    run(writer, inputs, "no device", EFFORT)
    assert json.loads(writer.file.built.read_text())["rows"] == figures["rows"]
    assert "| mask dilated | 0 px |" in paper_stability(figures)
