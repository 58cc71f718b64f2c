"""Splats trained on another program's test set, judged on its other two folders.

Poses are exact, but the layout cannot say so: `metanerf train` refines them, and puts a surface of
its own round the joints. What that costs is told by the same training that believes the poses, and
by one that is given the true surface, too. PSNR, SSIM and LPIPS of the body crop, poses as given.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.foreign.dataset import (
    FRAMES,
    SIZE,
    TRAIN,
    write_dataset,
)
from benchmarks.foreign.figure import make_figure
from benchmarks.frontier.training import figures_of
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import Clock, clock_named
from capture.sources.readers import open_folder
from renderer.evaluation.evaluate import evaluate
from renderer.training import train
from scene.body import Body
from scene.sequence import NOVEL_VIEW, UNSEEN_POSE, Sequence

BUDGETS_S = (20.0, 120.0)
AS_TRAINED, BELIEVED, TRUE_SURFACE = "as trained", "poses believed", "true surface"
WAYS = (AS_TRAINED, BELIEVED, TRUE_SURFACE)
"""As the command trains it; with the poses left alone; so, and from the surface that was drawn."""


def run(writer: FigureWriter, backbone: Path | None, clock_name: str, only: str) -> None:
    """Write the set, measure what was not measured yet, and report."""
    cache, clock, rows = writer.cache(only), clock_named(clock_name), []
    about = {"frames": FRAMES, "size": SIZE, "region": "body crop", **clock.about()}
    lpips = None if backbone is None else backbone.name
    with TemporaryDirectory() as folder:
        write_dataset(Path(folder))
        clip = opened(Path(folder))
        for way in WAYS:
            for budget_s in BUDGETS_S:
                key = {"way": way, "budget_s": budget_s}
                row = cache.measured(
                    f"{way}/{budget_s:g}",
                    {**key, **about, "lpips": lpips},
                    lambda k=key: _row(clip, k["way"], k["budget_s"], backbone, clock),
                )
                rows += [] if row is None else [{**key, **row}]
    writer.write({**about, "rows": rows})


def opened(folder: Path) -> Sequence:
    """The folders of `write_dataset` as one sequence, read as `metanerf train` reads them."""
    clip, *tests = (open_folder(folder / name) for name in (TRAIN, NOVEL_VIEW, UNSEEN_POSE))
    return replace(
        clip,
        test={
            name: test.train for name, test in zip((NOVEL_VIEW, UNSEEN_POSE), tests, strict=True)
        },
    )


def with_true_surface(clip: Sequence) -> Sequence:
    """`clip` with the surface and the blend weights that its pictures were drawn with."""
    figure, skeleton = make_figure(), clip.body.skeleton
    vertices = figure.vertices + skeleton.rest_joints[0] - figure.joints[0]
    return replace(clip, body=Body(skeleton, vertices, figure.faces, figure.weights))


def _row(
    clip: Sequence, way: str, budget_s: float, backbone: Path | None, clock: Clock
) -> dict[str, Any]:
    clip = replace(clip, exact_poses=way != AS_TRAINED)
    if way == TRUE_SURFACE:
        clip = with_true_surface(clip)
    model = train(clip, preset="splats", budget_s=budget_s, find_light=True, clock=clock.now)
    return figures_of(model, evaluate(model, clip, backbone))
