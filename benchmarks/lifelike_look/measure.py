"""Live look on lifelike performers: from beside their webcam, against what a camera there sees.

Each is trained on one turn; then a hand goes across the chest, or the face does what the clip did
not hold, before a synthetic webcam (`benchmarks.lifelike_look.webcam`). Without live look, in the
pose of the landmarks, and with it, in the pose that the picture was aligned with, they are seen
from the webcam's place and from beside and behind it, each by a camera carried round the chest as
far as that which shows the truth, and judged on the crop of the body and on that of the hand or the
face. What colours alone bring is told by the model in the aligned pose.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lifelike_look.performances import (
    FRAMES,
    PLAYED_HZ,
    SECONDS,
    SIZE_PX,
    WEBCAM_PX,
    Performance,
    performances,
    trained_clip,
)
from benchmarks.lifelike_look.sheet import LookedAt, Shown, draw_sheet
from benchmarks.lifelike_look.webcam import AS_FOUND, GivenTruth, SyntheticWebcam
from benchmarks.real.judge import crop_lpips
from benchmarks.real.measure import Networks, trained_model
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.measurements import MeasurementCache
from capture.studio.lifelike.performer import make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.lpips import Lpips
from renderer.evaluation.metrics import psnr
from renderer.live_look.live_look import LiveLook
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.arrays import Array, Float
from scene.sequence import Frame, body_crop
from services.joining.finder import PersonFinder

CAST = ("hazel", "jasper")
BESIDE_DEG = (0.0, 10.0, 20.0, 40.0)
BEHIND_DEG = (90.0, 135.0, 180.0)
FLICKER_DEG = (0.0, 20.0, 40.0)
MUST, AIM = {10.0: 0.6, 20.0: 0.7, 40.0: 0.85}, {10.0: 0.3, 20.0: 0.4, 40.0: 0.6}
"""LPIPS as a share of that without live look, by degrees beside the webcam."""
MUST_BEHIND, MUST_FLICKER = 1.0, 1.2
"""The same from beyond 75 degrees; flicker as a share of that of the model in the same pose."""
FIRST, _EVERY = 8, 5
"""Pictures before the first that is judged, and from one to the next."""


def measure_cast(
    writer: FigureWriter,
    cache: MeasurementCache,
    assets: Path,
    networks: Networks,
    iterations: int,
) -> dict[str, Any]:
    """Measure who was not measured yet; the figures of all, by name."""
    conditions = {
        "frames": FRAMES,
        "size": SIZE_PX,
        "webcam_px": list(WEBCAM_PX),
        "played_hz": PLAYED_HZ,
        "seconds": SECONDS,
    }
    cast: dict[str, Any] = {}
    for name in CAST:
        sheet = writer.picture(f"live-look-{name}.jpg")
        found = cache.measured(
            name,
            {**conditions, "iterations": iterations, "lpips": networks.lpips.name},
            lambda n=name, s=sheet: measure_performer(n, assets, networks, iterations, s),
        )
        if found is not None:
            cast[name] = found
    return {**conditions, "cast": cast}


def measure_performer(
    name: str,
    assets: Path,
    networks: Networks,
    iterations: int,
    sheet: Path,
    given: GivenTruth = AS_FOUND,
) -> dict[str, Any]:
    """The figures of one performer; their contact sheet is written to `sheet`."""
    performer = make_lifelike_performer(LIFELIKE_PERFORMERS[name], assets, expressive=True)
    lpips, looked_at = Lpips(networks.lpips), dict[str, list[LookedAt]]()
    with tempfile.TemporaryDirectory() as folder:
        clip = trained_clip(performer, name, Path(folder) / "clip")
        model = trained_model(clip, iterations).splats
    assert model is not None
    milliseconds: list[float] = []
    for performance in performances(performer):
        with PersonFinder(networks.pose, networks.face, networks.hand) as finder:
            webcam = SyntheticWebcam(performance, finder, given)
            looked_at[performance.name] = list(played(performance, webcam, model, milliseconds))
    draw_sheet(sheet, model, looked_at.values())
    return {
        "splats": len(model),
        "picture_ms": round(float(np.median(milliseconds)), 1),
        "performances": {name: judged(shown, model, lpips) for name, shown in looked_at.items()},
    }


def played(
    performance: Performance, webcam: SyntheticWebcam, model: SplatModel, milliseconds: list[float]
) -> Iterator[LookedAt]:
    """The judged pictures of a performance, and the one after each, as live look plays."""
    look = LiveLook(model)
    for count, seen in enumerate(webcam.pictures(model.skeleton)):
        begun = time.perf_counter()
        pose, appearance = look.see(seen.picture)
        milliseconds.append(1e3 * (time.perf_counter() - begun))
        if count >= FIRST and (count - FIRST) % _EVERY < 2:
            solved = seen.picture.pose
            yield LookedAt(performance, seen.number, seen.camera, solved, pose, appearance)


def judged(shown: list[LookedAt], model: SplatModel, lpips: Lpips) -> dict[str, Any]:
    """By degrees beside the webcam: LPIPS and PSNR (dB) of body and part, and flicker; of each that
    may be shown."""
    renderer, found = SplatRenderer((model,)), dict[str, Any]()
    for degrees in (*BESIDE_DEG, *BEHIND_DEG):
        figures: dict[Shown, dict[str, list[float]]] = {"off": {}, "model": {}, "live": {}}
        before: tuple[Frame, dict[Shown, Array]] | None = None
        for place, one in enumerate(shown):
            is_after = place % 2 == 1
            if is_after and degrees not in FLICKER_DEG:
                continue
            truth = one.performance.truth(one.number, degrees)
            pictures: dict[Shown, Array] = {
                name: one.rendered(renderer, model, degrees, name) for name in figures
            }
            for name, picture in pictures.items():
                if not is_after:
                    _add(figures[name], _of_picture(lpips, picture, truth, one.performance))
                elif before is not None:
                    flicker = _flicker((before[1][name], picture), (before[0], truth))
                    _add(figures[name], {"flicker": flicker})
            before = truth, pictures
        found[f"{degrees:g}"] = {
            name: {key: round(float(np.mean(values)), 4) for key, values in one.items()}
            for name, one in figures.items()
        }
    return {"frames": sum(1 for place in range(len(shown)) if place % 2 == 0), **found}


def _add(figures: dict[str, list[float]], more: dict[str, float]) -> None:
    for name, value in more.items():
        figures.setdefault(name, []).append(value)


def _of_picture(
    lpips: Lpips, picture: Float[Array, "H W 3"], truth: Frame, performance: Performance
) -> dict[str, float]:
    found: dict[str, float] = {}
    for part, window in (("body", body_crop(truth.mask)), ("part", performance.part(truth))):
        if window is not None:
            pair = picture[window], truth.image[window]
            found |= {part: crop_lpips(lpips, *pair), f"{part}_psnr": min(psnr(*pair), 100.0)}
    return found


def _flicker(pictures: tuple[Array, Array], frames: tuple[Frame, Frame]) -> float:
    """How much the picture changes beside how much the truth does, mean over the person."""
    person = (frames[0].mask > 0.5) | (frames[1].mask > 0.5)
    made, true = (
        float(np.abs(late - early)[person].mean())
        for early, late in (pictures, (frames[0].image, frames[1].image))
    )
    return made / max(true, 1e-6)
