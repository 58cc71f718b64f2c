"""Which part of which page shows which figures, and the command that makes all of them anew."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.frontier.charts import draw_charts
from benchmarks.pages import capture, splats, stability
from benchmarks.pages.ablation import ablation
from benchmarks.pages.faults import faults
from benchmarks.pages.frontier import frontier
from benchmarks.pages.gpu import gpu
from benchmarks.pages.install import install
from benchmarks.pages.levels import levels_room, levels_small
from benchmarks.pages.lipsync import lipsync
from benchmarks.pages.live_look import live_look, local_look, look_cost
from benchmarks.pages.load import estimate, load
from benchmarks.pages.numbers import SOURCES, numbers
from benchmarks.pages.parsimony import parsimony
from benchmarks.pages.performers import (
    covered_torso,
    expressions_found,
    lifelike,
    performers,
)
from benchmarks.pages.provenance import Figures
from benchmarks.pages.real import live_head, real
from benchmarks.pages.renderers import renderers
from benchmarks.parsimony.charts import draw_parsimony
from benchmarks.reporting.markdown import replaced
from benchmarks.stability import charts as stability_charts
from benchmarks.training_time import draw_chart

FIGURES = Path("docs/figures")
_FIGURES_PAGE = "docs/figures/README.md"
_STABILITY_PAGE = "docs/stability.md"


@dataclass(frozen=True)
class Block:
    """What stands between the markers `name` of a page."""

    page: str
    """From the root of the checkout."""
    name: str
    sources: tuple[str, ...]
    """Files of figures, without `.json`."""
    text: Callable[..., str]
    """Of the sources' figures, one after the other."""


BLOCKS = (
    Block("README.md", "performers", ("performers",), performers),
    Block("README.md", "numbers", SOURCES, numbers),
    Block("README.md", "capture", ("capture",), capture.summary),
    Block(_FIGURES_PAGE, "masks", ("masks",), capture.masks),
    Block(_FIGURES_PAGE, "stages", ("capture",), capture.stages),
    Block(_FIGURES_PAGE, "clips", ("capture",), capture.clips),
    Block(_FIGURES_PAGE, "live", ("live-capture",), capture.live),
    Block("docs/capture.md", "capture", ("capture",), capture.accuracy),
    Block("docs/keypoints.md", "expressions-found", ("expressions-found",), expressions_found),
    Block("docs/keypoints.md", "live-head", ("live-head",), live_head),
    Block("docs/data.md", "lifelike", ("lifelike",), lifelike),
    Block("docs/data.md", "covered-torso", ("covered-torso",), covered_torso),
    Block("docs/data.md", "reading", ("reading",), splats.reading),
    Block("docs/frontier.md", "foreign", ("foreign",), splats.foreign),
    Block("docs/frontier.md", "frontier", ("frontier",), frontier),
    Block(_STABILITY_PAGE, "finding", ("stability",), stability.finding),
    Block(_STABILITY_PAGE, "stability", ("stability",), stability.stability),
    Block(_STABILITY_PAGE, "paper-stability", ("paper-stability",), stability.paper_stability),
    Block("docs/gpu.md", "gpu", ("gpu",), gpu),
    Block("docs/streaming.md", "renderers", ("renderers",), renderers),
    Block("docs/streaming.md", "lipsync", ("lipsync",), lipsync),
    Block("docs/room.md", "relight", ("relight",), splats.relight),
    Block("docs/real-people.md", "real", ("real",), real),
    Block("docs/live-look.md", "live-look", ("live-look",), live_look),
    Block("docs/live-look.md", "local-look", ("local-look",), local_look),
    Block("docs/live-look.md", "look-cost", ("look-cost",), look_cost),
    Block("docs/levels.md", "levels-small", ("levels",), levels_small),
    Block("docs/levels.md", "levels-room", ("levels",), levels_room),
    Block("docs/load.md", "load", ("load",), load),
    Block("docs/load.md", "estimate", ("load",), estimate),
    Block("docs/faults.md", "faults", ("faults",), faults),
    Block("docs/parsimony.md", "parsimony", ("parsimony",), parsimony),
    Block("docs/parsimony.md", "ablation", ("ablation",), ablation),
    Block("docs/parsimony.md", "install", ("install",), install),
    Block(_FIGURES_PAGE, "trainings", ("expressions",), splats.trainings),
    Block(_FIGURES_PAGE, "expressions", ("expressions",), splats.expressions),
    Block(_FIGURES_PAGE, "local-view", ("local-view",), splats.local_view),
    Block(_FIGURES_PAGE, "meeting", ("meeting",), splats.meeting),
)


def made_anew(root: Path) -> dict[Path, str]:
    """Every page with generated parts, as the committed figures would have it.

    Raises InvalidInput where a page lacks a block's markers.
    """
    pages: dict[Path, str] = {}
    for block in BLOCKS:
        if not all(_path(root, name).exists() for name in block.sources):
            continue  # a new benchmark, of which nothing has been committed
        path = root / block.page
        text = block.text(*(_figures(root, name) for name in block.sources))
        pages[path] = replaced(pages.get(path) or path.read_text(), block.name, text)
    return pages


def write_pages(root: Path) -> list[Path]:
    """Write the pages that differ from the committed figures, and draw the charts; which pages."""
    changed = [(path, text) for path, text in made_anew(root).items() if path.read_text() != text]
    for path, text in changed:
        path.write_text(text)
    draw_chart(_figures(root, "train"), root / FIGURES / "train.png")
    frontier_figures = _figures(root, "frontier")
    draw_charts(frontier_figures, frontier_figures["points"], root / FIGURES / "frontier.json")
    stability_charts.draw_charts(_figures(root, "stability"), root / FIGURES)
    if _path(root, "parsimony").exists():
        draw_parsimony(_figures(root, "parsimony"), root / FIGURES / "parsimony.png")
    return [path for path, _ in changed]


def _figures(root: Path, name: str) -> Figures:
    return json.loads(_path(root, name).read_text())


def _path(root: Path, name: str) -> Path:
    return root / FIGURES / f"{name}.json"
