"""The quick corner of the ladder, really measured: few splats cost accuracy and spare the rest."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.pages.parsimony import parsimony
from benchmarks.parsimony import costs
from benchmarks.parsimony.measure import run
from benchmarks.parsimony.rungs import QUICK
from benchmarks.parsimony.subjects import OutsideData
from benchmarks.real.measure import Networks
from benchmarks.reporting.checkout import Checkout
from benchmarks.reporting.figures import FigureWriter
from renderer.evaluation.lpips import PACKAGED_BACKBONE

FEW = 500
PROMISED_DB, PROMISED_LPIPS = 0.2, 1.03
"""What `auto` may be worse by than all splats."""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parsimony")


def measured(root: Path) -> dict[str, Any]:
    unused = Path("unused")
    networks = Networks(unused, unused, unused, PACKAGED_BACKBONE)
    writer = FigureWriter.start("parsimony", checkout=Checkout(root), words=["bench"])
    run(writer, OutsideData(unused, unused, unused, networks), "processor", "", quick=True)
    return json.loads(writer.file.built.read_text())


@pytest.fixture(scope="module")
def figures(root: Path) -> dict[str, Any]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(costs, "VIEW_PX", 128)
        return measured(root)


@pytest.fixture
def by_name(figures: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in figures["rows"]}


def test_every_rung_of_the_corner_has_a_row(by_name):
    assert list(by_name) == [rung.name for rung in QUICK]


def test_few_splats_are_plainly_worse_than_all(by_name):
    few, whole = by_name[str(FEW)], by_name["full"]
    assert few["splats"] == FEW
    assert few["body_psnr"] < whole["body_psnr"] - 3.0
    assert few["body_lpips"] > 3.0 * whole["body_lpips"]


def test_as_few_as_the_clip_needs_keep_what_was_promised(by_name):
    auto, whole = by_name["auto"], by_name["full"]
    assert FEW < auto["splats"] < whole["splats"]
    assert auto["body_psnr"] > whole["body_psnr"] - PROMISED_DB
    assert auto["body_lpips"] < whole["body_lpips"] * PROMISED_LPIPS


@pytest.mark.parametrize("cost", ["parameters", "megabytes", "viewer_megabytes"])
def test_more_splats_cost_more(by_name, cost: str):
    few, auto, whole = (by_name[name][cost] for name in (str(FEW), "auto", "full"))
    assert few < auto < whole


def test_the_page_shows_the_corner_and_nothing_is_measured_twice(root, figures, capsys):
    page = parsimony(figures)
    assert f"| {FEW} splats | " in page
    assert measured(root)["rows"] == figures["rows"]
    assert "uniform/" not in capsys.readouterr().out
