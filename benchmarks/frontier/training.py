"""Models for the frontier: trained once each, kept in files, gone on with where they were cut.

The paper's presets would take weeks on CPU cores. Theirs is a *scaled* run, marked as such wherever
its figures stand: the same networks, losses and rates, with fewer patches a step, fewer samples a
ray and fewer steps, all schedules shortened alike. It counts processor seconds of one thread, so
that it can be cut, run beside other work and gone on with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.reporting.timing import Clock
from renderer.evaluation.evaluate import MEASURES, evaluate
from renderer.model_files import load_model, save_model
from renderer.performer_model import PerformerModel
from renderer.presets import EXACT, Preset, find_preset
from renderer.training import Progress, train
from scene.sequence import Sequence


@dataclass(frozen=True)
class Scale:
    """How far a published training is cut down."""

    patches: int
    """Patches of 20 x 20 px a step, all of one frame (the paper: 6)."""
    samples: int
    """Samples of a ray (the paper: 128)."""

    def of(self, preset: Preset) -> Preset:
        """`preset` cut down. Samples where nobody can be are skipped, which leaves the weights as
        they would be (`cull`)."""
        settings = preset.field_settings
        settings = replace(
            settings,
            rays_a_frame=self.patches * settings.patch_px**2,
            sizes=replace(settings.sizes, samples_a_ray=self.samples, cull=True),
        )
        return replace(preset, settings=settings)


SCALED = {"humannerf": Scale(patches=2, samples=32), "paper": Scale(patches=2, samples=32)}
"""The paper's presets on CPU cores. A step's price has a part that neither patches nor samples
change, the weight-volume CNN: with fewer patches than two it would be most of it."""
RUNS = {
    "splats": (2.0, 5.0, 10.0, 20.0, 60.0),
    "fast": (10.0, 30.0, 60.0, 90.0, 180.0),
    "paper+grid+cull+occupancy+early-stop+baked": (30.0, 90.0, 180.0),
}
"""Budgets, s, of what trains on CPU cores as it is."""
_TELL_EVERY_S = 60.0


def accuracy(
    clip: Sequence, name: str, budget_s: float, folder: Path, backbone: Path | None, clock: Clock
) -> dict[str, Any]:
    """Figures of preset `name` after `budget_s`, body crop and whole image, and its file's size.

    A scaled run's model is judged as its preset draws it, with all exact speed-ups.
    """
    model, path = trained(clip, name, budget_s, folder, backbone, clock)
    if name in SCALED:
        model = model.drawn_as(find_preset("+".join((name, *EXACT))))
    figures = figures_of(model, evaluate(model, clip, backbone))
    return {"file_megabytes": round(path.stat().st_size / 1e6, 2), **figures}


def figures_of(model: PerformerModel, figures: dict[str, Any]) -> dict[str, Any]:
    """An evaluation as one flat row, `MEASURE_SPLIT_REGION`, with what the model says of itself."""
    row = dict(model.metrics)
    for measure in MEASURES:
        for split, regions in figures[measure].items():
            for region, value in regions.items():
                row[f"{measure}_{split}_{region}"] = value
    return {**row, "conditions": figures["conditions"]}


def trained(
    clip: Sequence, name: str, budget_s: float, folder: Path, backbone: Path | None, clock: Clock
) -> tuple[PerformerModel, Path]:
    """The model of preset `name` after `budget_s`, and its file in `folder`, where it is taken from
    if it has been made."""
    path = folder / f"{name}-{budget_s:g}s-{clock.name}.safetensors"
    if path.exists():
        return load_model(path), path
    preset, perceptual = find_preset(name), None
    if name in SCALED:
        preset, perceptual = SCALED[name].of(preset), backbone
    checkpoint = path.with_suffix(".checkpoint")
    model = train(
        clip,
        preset=preset,
        budget_s=budget_s,
        lpips_backbone=perceptual,
        checkpoint=checkpoint,
        on_progress=_telling(name),
        clock=clock.now,
    )
    if name in SCALED:
        model.metrics["scaled"] = asdict(SCALED[name])
    save_model(model, path)
    checkpoint.unlink(missing_ok=True)
    return model, path


def _telling(name: str) -> Callable[[Progress], None]:
    """Prints now and then how far a long training has come."""
    due_s = _TELL_EVERY_S

    def tell(progress: Progress) -> None:
        nonlocal due_s
        if progress.elapsed_s >= due_s:
            due_s = progress.elapsed_s + _TELL_EVERY_S
            print(f"{name}: {progress.elapsed_s:.0f} s, {progress.message}", flush=True)

    return tell
