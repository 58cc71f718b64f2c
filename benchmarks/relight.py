"""Performers captured in one light and shown in another: as captured, and relit, in dB.

As filmed is what the other room would show of them if it had no light: that of their clip.

The studio films by the whole panorama, summed over every pixel; the renderer knows nine numbers and
a key light of it. The camera exposes for the light and, as cameras do, balances its colour; the
room they are shown in keeps its tint. Neither side knows of shadows that a body casts on itself.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.reporting.cells import in_a_cell
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import Clock, clock_named, milliseconds
from capture.sources.panorama import read_panorama
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.light import EnvironmentLight
from capture.studio.named_performers import seed_of_performer
from capture.studio.performer import StudioPerformer, make_performer, render_performer
from renderer.evaluation.metrics import psnr
from renderer.relighting.shading import Relighting
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.training import train
from scene.arrays import Array, Float
from scene.environment import Environment
from scene.errors import InvalidInput
from scene.lighting import solid_angles
from scene.sequence import NOVEL_VIEW, Sequence, body_crop

PERFORMERS = ("amber", "basil")
FILMED_IN, SHOWN_IN = ("apartment", "park"), ("apartment", "lobby", "park")
BUDGET_S = 10.0
_SIZE, _VIEWS = 256, 8
_CELL_PX = (200, 120)
"""Height and width of a body in the comparison."""
_TIMED = 200


@dataclass(frozen=True, eq=False)
class _Comparison:
    figures: dict[str, Any]
    strip: Float[Array, "H W 3"]
    """As filmed, relit, truth."""


def run(writer: FigureWriter, panoramas: Path, picture: Path | None, clock_name: str) -> None:
    """Measure, report, and draw the comparison."""
    clock = clock_named(clock_name)
    rooms = {name: _panorama(panoramas, name) for name in SHOWN_IN}
    rows, strips, seconds = [], [], {}
    for performer in PERFORMERS:
        for filmed_in in FILMED_IN:
            with tempfile.TemporaryDirectory() as folder:
                clip = _render_clip(Path(folder) / "clip", performer, filmed_in, rooms[filmed_in])
                model, fit_s = _trained(clip, clock)
                for shown_in in SHOWN_IN:
                    if shown_in == filmed_in:
                        continue
                    shown = Environment.of_panorama(shown_in, rooms[shown_in])
                    compared = _compare(
                        model, clip, make_performer(seed_of_performer(performer)), shown
                    )
                    about = {"performer": performer, "filmed_in": filmed_in, "shown_in": shown_in}
                    rows.append({**about, **compared.figures})
                    strips.append(compared.strip)
                    print(rows[-1], flush=True)
                    seconds = {"fit_s": round(fit_s, 2), **_cost(model, shown, clock)}
    figures = {
        "region": "body crop, black background, sRGB",
        "views": _VIEWS,
        "size": _SIZE,
        "splats": 10_000,
        "training_s": BUDGET_S,
        **clock.about(),
        "rows": rows,
        "least_gain_db": min(row["gain_db"] for row in rows),
        "relighting": seconds,
    }
    writer.write(figures)
    if picture is not None:
        picture.parent.mkdir(parents=True, exist_ok=True)
        half = len(strips) // 2
        sheet = np.hstack([np.vstack(strips[:half]), np.vstack(strips[half:])])
        cv2.imwrite(str(picture), (sheet[..., ::-1] * 255.0 + 0.5).astype(np.uint8))


def _panorama(folder: Path, name: str) -> Float[Array, "H W 3"]:
    found = sorted(folder.glob(f"*{name}*.hdr"))
    if not found:
        raise InvalidInput(
            f"panoramas must hold a Radiance .hdr file named after {', '.join(SHOWN_IN)}; got none "
            f"for {name} in {folder}; they are Poly Haven's (github.com/pmndrs/assets, src/hdri)"
        )
    return read_panorama(found[0])


def _render_clip(folder: Path, performer: str, name: str, room: Float[Array, "H W 3"]) -> Sequence:
    mean = (room * solid_angles(*room.shape[:2])[..., None]).sum(axis=(0, 1)) / (4.0 * np.pi)
    balanced = Environment.of_panorama(name, room / mean)
    make_sequence(folder, performer=performer, look="lit", environment=balanced, size=_SIZE)
    return open_sequence(folder)


def _trained(clip: Sequence, clock: Clock) -> tuple[SplatModel, float]:
    started = clock.now()
    model = train(clip, preset="splats", budget_s=BUDGET_S, find_light=True, clock=clock.now)
    taken_s = clock.now() - started
    assert model.splats is not None
    return model.splats, taken_s - BUDGET_S


def _compare(
    model: SplatModel, clip: Sequence, performer: StudioPerformer, shown: Environment
) -> _Comparison:
    assert shown.panorama is not None
    light, source = EnvironmentLight(shown.panorama), clip.test[NOVEL_VIEW]
    renderer, figures = SplatRenderer((model,)), []
    strip = np.zeros((*_CELL_PX, 3))
    for index in np.linspace(0, len(source) - 1, _VIEWS).round().astype(int).tolist():
        camera, pose = source.camera(index), source.pose(index)
        truth, alpha = render_performer(performer, pose, camera, "lit", light=light)
        crop = body_crop(alpha)
        assert crop is not None
        moved = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        rendered = [
            np.clip(renderer.render(camera, [moved], lighting)[..., :3], 0.0, 1.0)
            for lighting in (None, shown.lighting)
        ]
        figures.append([psnr(one[crop], truth[crop]) for one in rendered])
        if index == 0:
            cells = [one[crop] for one in (*rendered, truth)]
            strip = np.hstack([in_a_cell(cell, _CELL_PX) for cell in cells])
    unlit, relit = np.mean(figures, axis=0)
    return _Comparison(
        {
            "psnr_as_filmed": round(float(unlit), 2),
            "psnr_relit": round(float(relit), 2),
            "gain_db": round(float(relit - unlit), 2),
        },
        strip,
    )


def _cost(model: SplatModel, shown: Environment, clock: Clock) -> dict[str, float]:
    """Time of the light alone, all splats, a picture's worth."""
    assert shown.lighting is not None
    relighting, parameters = Relighting((model,)), model.parameters.copy()
    joints, seconds, eye = model.joints.astype(np.uint16), [], np.array([0.0, 1.0, 3.0])
    for frame in range(-10, _TIMED):
        pose = model.motion.pose(frame % len(model.motion))
        moved = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        transforms = moved.astype(np.float32)
        started = clock.now()
        relighting.shade(parameters, joints, model.weights, transforms, eye, shown.lighting)
        if frame >= 0:
            seconds.append(clock.now() - started)
    return milliseconds(seconds)
