"""Milliseconds a frame of the frontier's presets: pose to pixels, batch 1, live transforms.

The paper's two presets are timed with the same weights throughout: a field that fits the clip's own
body takes the place of one that was trained for hours, since what a speed-up skips depends on the
shape alone. Where a frame would take minutes, a smaller one is timed and its time multiplied with
the ratio of the pixels, which is marked as an estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.field_speed import SAME_WEIGHTS, fitted
from benchmarks.reporting.timing import Clock, milliseconds
from renderer.catalogue import describe_preset
from renderer.evaluation.metrics import psnr
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.performer_model import PerformerModel
from renderer.presets import EXACT, find_preset
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.arrays import Array
from scene.camera import Camera
from scene.motion import Pose
from scene.sequence import NOVEL_VIEW, Sequence

SIZES = (512, 1024)
BASES = ("humannerf", "paper")
STEPS = tuple(
    "+".join((base, *names))
    for base in BASES
    for names in ((), *((name,) for name in SAME_WEIGHTS), EXACT)
)
"""Each base, each of its speed-ups alone, and all exact ones together."""
_FIT_STEPS = 400
_FRAMES = 20
"""Frames of a measurement, where time allows."""
_PATIENCE_S = 20.0
"""About how long one size of one preset is timed."""
_LEAST_PX, _LEAST_FRAMES = 64, 3
_COMPARED_PX = 128

Draw = Callable[[Camera, Pose], Array]


def drawing(model: PerformerModel) -> Draw:
    """How a server draws `model`: what lasts is kept between frames, transforms are not."""
    if model.splats is None:
        return model.render
    renderer, skeleton = SplatRenderer((model.splats,)), model.skeleton
    return lambda camera, pose: renderer.render(
        camera, [skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)]
    )


@dataclass(frozen=True)
class _View:
    camera: Camera
    pose: Pose


def timed_steps(clip: Sequence, name: str, clock: Clock, fields: dict[str, Any]) -> dict[str, Any]:
    """Times of the paper's preset `name`, perhaps with speed-ups, and its picture's distance from
    the reference path's. `fields` keeps the fitted field of each base between calls."""
    base = name.split("+")[0]
    settings, plain = find_preset(name).field_settings, find_preset(base).field_settings
    if base not in fields:
        fields[base] = fitted(plain, clip.body, _FIT_STEPS)
    field = fields[base]
    field.sizes = plain.sizes
    view = _views(clip, _COMPARED_PX)[0]
    reference = FieldRenderer(field).render(view.camera, view.pose)
    field.sizes = settings.sizes
    renderer = FieldRenderer(field)
    rendered = renderer.render(view.camera, view.pose)
    return {
        **timed(clip, renderer.render, clock),
        "db_to_slow": round(min(psnr(rendered[..., :3], reference[..., :3]), 150.0), 1),
        **weights_of(name),
    }


def timed(clip: Sequence, draw: Draw, clock: Clock) -> dict[str, Any]:
    """{"512": {p50_ms, p95_ms, frames, measured_px}, ...} over the clip's unseen views."""
    _seconds(clip, draw, clock, _LEAST_PX, 1)  # warms up
    least_s = _seconds(clip, draw, clock, _LEAST_PX, 1)[0]
    taken: dict[int, list[float]] = {}
    rows = {}
    for size in SIZES:
        px = size
        while px > _LEAST_PX and _LEAST_FRAMES * _expected_s(least_s, px) > _PATIENCE_S:
            px //= 2
        if px not in taken:  # two sizes may be estimated from the same one
            most = _PATIENCE_S / max(_expected_s(least_s, px), 1e-4)
            frames = int(np.clip(most, _LEAST_FRAMES, _FRAMES))
            taken[px] = _seconds(clip, draw, clock, px, frames)
        scaled = [(size / px) ** 2 * second for second in taken[px]]
        rows[str(size)] = {**milliseconds(scaled), "frames": len(scaled), "measured_px": px}
    return rows


def _expected_s(least_s: float, px: int) -> float:
    return least_s * (px / _LEAST_PX) ** 2


def weights_of(name: str) -> dict[str, Any]:
    """Parameters and megabytes of a preset."""
    about = describe_preset(find_preset(name))
    return {"parameters": sum(about["parameters"].values()), "megabytes": about["megabytes"]}


def _seconds(clip: Sequence, draw: Draw, clock: Clock, px: int, frames: int) -> list[float]:
    views, seconds = _views(clip, px), []
    for number in range(frames):
        view = views[number % len(views)]
        started = clock.now()
        draw(view.camera, view.pose)
        seconds.append(clock.now() - started)
    return seconds


def _views(clip: Sequence, px: int) -> list[_View]:
    source = clip.test[NOVEL_VIEW]
    return [_View(source.camera(i).resized(px, px), source.pose(i)) for i in range(len(source))]
