"""What a model costs whoever keeps it and draws it."""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.frontier.speed import drawing
from benchmarks.reporting.timing import Clock, milliseconds
from renderer.model_files import save_model
from renderer.performer_model import PerformerModel
from scene.camera import orbit_camera

VIEW_PX = 512


def costs(model: PerformerModel, clock: Clock, views: int = 12) -> dict[str, float]:
    """`parameters` and `megabytes` of its file, `p50_ms` and `p95_ms` of a view.

    Parameters are all numbers that are no integers, learnt or not.
    """
    held = [tensor for tensor in model.tensors().values() if tensor.dtype.kind == "f"]
    return {
        "parameters": sum(tensor.size for tensor in held),
        "megabytes": _megabytes(model),
        **_milliseconds(model, clock, views),
    }


def _megabytes(model: PerformerModel) -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        save_model(model, path)
        return round(os.path.getsize(path) / 1e6, 3)


def _milliseconds(model: PerformerModel, clock: Clock, views: int) -> dict[str, float]:
    """Pose to pixels, from all round."""
    draw, skeleton = drawing(model), model.skeleton
    seconds = []
    for view in range(views + 1):
        pose = model.motion.pose(view * (len(model.motion) - 1) // views)
        height_m = pose.root_translation[1]
        eye_level = (0.0, 0.55 * skeleton.height_m + height_m, 0.0)
        camera = orbit_camera(eye_level, 2.0 * skeleton.height_m, view, 0.1, VIEW_PX, VIEW_PX)
        upright = replace(pose, root_translation=np.array([0.0, height_m, 0.0]))
        begun = clock.now()
        draw(camera, upright)
        seconds.append(clock.now() - begun)
    return milliseconds(seconds[1:])
