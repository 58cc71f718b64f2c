"""Pose and camera in, float RGBA out: ms a view of a splat model, live transforms, no cache."""

from __future__ import annotations

import time
from pathlib import Path

import numba
import numpy as np

from benchmarks.report import milliseconds, write_report
from capture.studio.moves import turning
from capture.studio.performer import make_performer
from renderer.splats.compose import SplatRenderer
from renderer.splats.initialise import sample_surface
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, ROTATION
from renderer.splats.model import SplatModel
from scene.camera import orbit_camera

SIZES = (256, 512, 1024)
VIEWS = 120


def run(json_file: Path | None, count: int) -> None:
    """Measure and report."""
    model = surface_model(count)
    renderer = SplatRenderer((model,))
    figures = {}
    for size in SIZES:
        seconds = []
        for view in range(-10, VIEWS):  # the first ten warm up
            camera = orbit_camera((0.0, 0.9, 0.0), 3.2, 0.05 * view, 0.05, size, size)
            pose = model.motion.pose(view % len(model.motion))
            started = time.perf_counter()
            transforms = model.skeleton.skinning_transforms(
                pose.joint_angles, pose.root_translation
            )
            renderer.render(camera, [transforms])
            if view >= 0:
                seconds.append(time.perf_counter() - started)
        figures[f"{size}x{size}"] = milliseconds(seconds)
    about = {"splats": count, "views": VIEWS, "threads": numba.get_num_threads(), "batch": 1}
    write_report(json_file, "views", {**about, "pose_to_rgba": figures})


def surface_model(count: int) -> SplatModel:
    """Splats on a studio performer's body, as training begins with them."""
    rng, body = np.random.default_rng(0), make_performer(0).body
    points, _, weights, area = sample_surface(body, count, rng)
    parameters = np.zeros((count, PARAMETERS), np.float32)
    parameters[:, :3] = points
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(0.6 * np.sqrt(area / count))
    parameters[:, ROTATION], parameters[:, OPACITY] = 1.0, 2.0
    parameters[:, COLOUR : COLOUR + 3] = rng.uniform(size=(count, 3))
    joints = np.argsort(-weights, axis=1)[:, :4].astype(np.uint8)
    top = np.take_along_axis(weights, joints.astype(int), axis=1).astype(np.float32)
    motion = turning(60, 30.0, 360.0)
    return SplatModel(
        parameters, joints, top, np.ones(count, bool), body.skeleton, motion, "benchmark"
    )
