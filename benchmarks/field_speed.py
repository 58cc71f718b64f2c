"""What each speed-up of the paper's field is worth on this machine, with the same weights.

A field that fits a studio body, painted with soft stripes, takes the place of one that was trained
for hours: what the speed-ups skip depends on its shape alone. Milliseconds a view at p50, pose to
pixels, batch 1, live transforms; dB of the picture against the slow path's.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from benchmarks.report import write_report
from capture.body import load_body_model
from renderer.field.drawing import FieldRenderer
from renderer.field.field import PersonField
from renderer.field.pruning import occupied_cells
from renderer.field.rest_shape import rest_shape
from renderer.field.settings import FieldSettings
from renderer.metrics import psnr
from renderer.presets import EXACT, SPEED_UPS, find_preset
from scene.arrays import Array
from scene.body import Body
from scene.camera import orbit_camera
from scene.motion import Pose
from scene.skeleton import JOINT_NAMES

SAME_WEIGHTS = ("cull", "occupancy", "early-stop", "baked", "posed-grid")
_RUNS = 3
_DENSITY, _SOFTNESS_M = 300.0, 0.004
_RATE = 2e-3


def run(json_file: Path | None, preset: str, size: int, steps: int) -> None:
    """Measure and report."""
    torch.set_num_threads(1)  # threads that wait for each other measure the neighbours' load
    settings = find_preset(preset).settings
    assert isinstance(settings, FieldSettings)
    model = load_body_model()
    field = _fitted(settings, model.body(np.zeros(model.shape_count)), steps)
    slow, slow_ms = _drawn(field, size)
    rows: list[dict[str, Any]] = [{"preset": preset, "ms": slow_ms}]
    for names in (*((name,) for name in SAME_WEIGHTS), EXACT):
        field.sizes = settings.sizes
        for name in names:
            field.sizes = SPEED_UPS[name].apply(field.sizes)
        picture, ms = _drawn(field, size)
        rows.append({
            "preset": "+".join([preset, *names]), "ms": ms, "times_faster": round(slow_ms / ms, 2),
            "db_to_slow": round(min(psnr(picture[..., :3], slow[..., :3]), 150.0), 1),
        })  # fmt: skip
        print(rows[-1], flush=True)
    write_report(
        json_file, "field-speed", {"size": size, "threads": 1, "fit_steps": steps, "rows": rows}
    )


def _drawn(field: PersonField, size: int) -> tuple[Array, float]:
    """A view, and how long it took, ms at p50."""
    renderer = FieldRenderer(field)
    camera = orbit_camera((0.0, 0.9, 0.0), 3.2, 0.3, 0.05, size, size)
    angles = np.zeros((len(JOINT_NAMES), 3))
    angles[JOINT_NAMES.index("left_shoulder"), 2] = -1.0
    angles[JOINT_NAMES.index("right_shoulder"), 2] = 1.0
    times = []
    for _ in range(_RUNS):
        started = time.perf_counter()
        picture = renderer.render(camera, Pose(angles, np.zeros(3)))
        times.append(1e3 * (time.perf_counter() - started))
    return picture, round(median(times), 1)


def _fitted(settings: FieldSettings, body: Body, steps: int) -> PersonField:
    """A field whose canonical MLP holds `body`, by regression on its signed distance."""
    assert body.rest_vertices is not None
    torch.manual_seed(0)
    field = PersonField.for_body(replace(settings.sizes, backend="torch"), body)
    shape = rest_shape(body, (48, 96, 96), 0.04)
    distance = torch.from_numpy(shape.signed_distance)[None, None]
    low, high = torch.from_numpy(shape.low), torch.from_numpy(shape.high)
    vertices = torch.from_numpy(body.rest_vertices).float()
    adam = torch.optim.Adam(field.canonical.parameters(), lr=_RATE)
    for step in range(steps):
        adam.param_groups[0]["lr"] = _RATE * 0.03 ** (step / steps)
        near = vertices[torch.randint(len(vertices), (2048,))]
        anywhere = low + torch.rand(2048, 3) * (high - low)
        at = torch.cat([near + 0.04 * torch.randn(near.shape), anywhere])
        grid = (2.0 * (at - low) / (high - low) - 1.0).view(1, 1, 1, -1, 3)
        away = functional.grid_sample(distance, grid, padding_mode="border", align_corners=True)
        wanted = _DENSITY * torch.sigmoid(-away.view(-1) / _SOFTNESS_M)
        paint = 0.5 + 0.4 * torch.sin(at[:, 1:2] * torch.tensor([20.0, 9.0, 4.0]))
        colours, density = field.canonical(at)
        apart = torch.log1p(density) - torch.log1p(wanted)
        loss = 0.1 * (apart**2).mean() + ((colours - paint) ** 2).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
    field.requires_grad_(False)
    field.residual_opened = 1.0
    field.occupied = occupied_cells(field.canonical, field.weight_volume())
    field.sizes = settings.sizes
    return field
