"""The lifelike performers, each by itself: photographic skin, hair and garments from new views.

60 frames of 256 x 256 from one camera, exact poses, 60 s of training, body crop. Each performer is
stored as soon as it is measured. The sheet holds a row a performer: the truth and the model, from
two views that training never saw.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.frontier.training import figures_of
from benchmarks.reporting.cells import in_a_cell
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import Clock, clock_named
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.evaluate import EvaluatedView, evaluate
from renderer.training import train
from scene.sequence import NOVEL_VIEW

BUDGET_S = 60.0
MUST, AIM = {"psnr": 32.0, "lpips": 0.05}, {"psnr": 36.0, "lpips": 0.03}
FRAMES, SIZE = 60, 256
_SHOWN = 2
_CELL_PX = 256, 160  # height, width
_ROWS_A_COLUMN = 4
_QUALITY = 90


def run(
    writer: FigureWriter,
    motion: Path,
    assets: Path,
    backbone: Path,
    clock_name: str,
    only: str,
) -> None:
    """Measure who was not measured yet, and report."""
    cache, clock = writer.cache(only), clock_named(clock_name)
    conditions = {
        "frames": FRAMES,
        "size": SIZE,
        "budget_s": BUDGET_S,
        "lpips": backbone.name,
        **clock.about(),
    }
    rows, strips = [], []
    for performer in LIFELIKE_PERFORMERS:
        strip = cache.folder / f"{performer}.png"
        row = cache.measured(
            performer,
            conditions,
            lambda name=performer, out=strip: _performer(
                name, motion, assets, backbone, clock, out
            ),
        )
        if row is not None:
            rows.append({**_looks(performer), **row})
            strips.append(strip)
    _draw(writer.picture("sheet.jpg"), strips)
    writer.write(
        {**conditions, "poses": "exact", "region": "body crop", "must": MUST, "aim": AIM}
        | {"rows": rows}
    )


def _looks(performer: str) -> dict[str, Any]:
    row = LIFELIKE_PERFORMERS[performer]
    return {
        "performer": performer,
        "tone": row.tone,
        "age": row.age,
        "skin": row.skin,
        "hair": row.hair or "none",
        "garments": list(row.garments),
    }


def _performer(
    performer: str, motion: Path, assets: Path, backbone: Path, clock: Clock, strip: Path
) -> dict[str, Any]:
    """One performer trained and judged; some views are drawn to `strip`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sequence"
        make_sequence(
            path,
            performer=performer,
            assets=assets,
            motion=motion,
            look="plain",
            frames=FRAMES,
            size=SIZE,
        )
        clip = open_sequence(path)
        model = train(clip, preset="splats", budget_s=BUDGET_S, find_light=True, clock=clock.now)
        views: list[EvaluatedView] = []
        figures = evaluate(
            model,
            clip,
            backbone,
            on_view=lambda view: views.append(view) if view.split == NOVEL_VIEW else None,
        )
    shown = [views[n * len(views) // _SHOWN] for n in range(_SHOWN)]
    pictures = [(view.crop, one) for view in shown for one in (view.truth, view.made)]
    cells = [in_a_cell(np.clip(one[crop], 0.0, 1.0), _CELL_PX) for crop, one in pictures if crop]
    strip.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(strip), (np.hstack(cells)[..., ::-1] * 255.0 + 0.5).astype(np.uint8))
    return figures_of(model, figures)


def _draw(path: Path, strips: list[Path]) -> None:
    """All strips, one below the other, in columns."""
    rows = [cv2.imread(str(strip)) for strip in strips]
    known = [row for row in rows if row is not None]
    if len(known) < len(LIFELIKE_PERFORMERS):
        return
    columns = [
        np.vstack(known[first : first + _ROWS_A_COLUMN])
        for first in range(0, len(known), _ROWS_A_COLUMN)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.hstack(columns), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
