"""What each speed-up of the paper's field is worth on this machine, with the same weights.

A field that fits a studio body, painted with soft stripes, takes the place of one that was trained
for hours: what the speed-ups skip depends on its shape alone. Milliseconds a view at p50, pose to
pixels, batch 1, live transforms, on one thread and by that thread's own clock, all presets in
turns; dB of the picture against the slow path's.
"""

from __future__ import annotations

import time
from copy import copy
from dataclasses import replace
from statistics import median

import numpy as np
import torch
from torch.nn import functional

from benchmarks.reporting.figures import FigureWriter
from capture.body.model import load_body_model
from renderer.evaluation.metrics import psnr
from renderer.field.field import PersonField
from renderer.field.rendering.field_renderer import FieldRenderer
from renderer.field.settings import FieldSettings
from renderer.field.sizes import FieldSizes
from renderer.field.skinning.rest_shape import rest_shape
from renderer.field.training.pruning import occupied_cells
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


def run(writer: FigureWriter, preset: str, size: int, steps: int) -> None:
    """Measure and report."""
    torch.set_num_threads(1)  # threads that wait for each other measure the neighbours' load
    settings = find_preset(preset).field_settings
    model = load_body_model()
    field = fitted(settings, model.body(np.zeros(model.shape_count)), steps)
    names = [(), *((name,) for name in SAME_WEIGHTS), EXACT]
    renderers = [FieldRenderer(with_speed_ups(field, settings.sizes, added)) for added in names]
    seconds: list[list[float]] = [[] for _ in renderers]
    pictures: list[Array] = []
    for turn in range(_RUNS):  # in turns: what else the machine does falls on all of them
        for renderer, taken in zip(renderers, seconds, strict=True):
            picture, spent_s = _drawn(renderer, size)
            taken.append(spent_s)
            if turn == 0:
                pictures.append(picture)
    rows = [
        {
            "preset": "+".join([preset, *added]),
            "ms": round(1e3 * median(taken), 1),
            "times_faster": round(median(seconds[0]) / median(taken), 2),
            "db_to_slow": round(min(psnr(picture[..., :3], pictures[0][..., :3]), 150.0), 1),
        }
        for added, taken, picture in zip(names, seconds, pictures, strict=True)
    ]
    writer.write({"size": size, "threads": 1, "fit_steps": steps, "rows": rows})


def with_speed_ups(
    field: PersonField, sizes: FieldSizes, speed_ups: tuple[str, ...]
) -> PersonField:
    """The same weights with speed-ups."""
    other = copy(field)
    for name in speed_ups:
        sizes = SPEED_UPS[name].apply(sizes)
    other.sizes = sizes
    return other


def _drawn(renderer: FieldRenderer, size: int) -> tuple[Array, float]:
    """A view, and how long this thread worked on it, s."""
    camera = orbit_camera((0.0, 0.9, 0.0), 3.2, 0.3, 0.05, size, size)
    angles = np.zeros((len(JOINT_NAMES), 3))
    angles[JOINT_NAMES.index("left_shoulder"), 2] = -1.0
    angles[JOINT_NAMES.index("right_shoulder"), 2] = 1.0
    started = time.thread_time()
    picture = renderer.render(camera, Pose(angles, np.zeros(3)))
    return picture, time.thread_time() - started


def fitted(settings: FieldSettings, body: Body, steps: int) -> PersonField:
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
        target = _DENSITY * torch.sigmoid(-away.view(-1) / _SOFTNESS_M)
        target_colours = 0.5 + 0.4 * torch.sin(at[:, 1:2] * torch.tensor([20.0, 9.0, 4.0]))
        colours, density = field.canonical(at)
        error = torch.log1p(density) - torch.log1p(target)
        loss = 0.1 * (error**2).mean() + ((colours - target_colours) ** 2).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
    field.requires_grad_(False)
    field.residual_opened = 1.0
    field.occupied = occupied_cells(field.canonical, field.weight_volume())
    field.sizes = settings.sizes
    return field
