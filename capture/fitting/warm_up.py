"""Compiles what fits run, ahead of the first: captures apart can keep no kernels."""

from __future__ import annotations

import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.body.landmarks import place_landmarks
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from capture.detection.lifter import closed_form
from capture.fitting.fit import ClipFit
from capture.fitting.observations import observe
from capture.fitting.optimiser import Descent

_SIDE_PX = 128


def warm_up() -> None:
    """Take one step of a fit to the mean body, which stands still before noise for two frames."""
    model, side = load_body_model(), _SIDE_PX
    world = place_landmarks(model).rest * OPENCV_TO_OPENGL
    pixels = 0.5 * side * (world[:, :2] - world[:, :2].mean(axis=0) + 1.0)
    mask = np.zeros((side, side), np.float32)
    mask[side // 8 : -side // 8, side // 3 : -side // 3] = 1.0
    person = Landmarks(pixels, world, np.ones(len(world)), mask)
    noise = list(np.random.default_rng(0).integers(0, 256, (2, side, side, 3), np.uint8))
    seen = observe(
        [person] * 2, [mask] * 2, np.array([0.0, 0.1]), np.zeros(2, int), closed_form, images=noise
    )
    fit = ClipFit(model, seen)
    fit.prepare(coarse=True)
    fit.associate()
    Descent(fit.state, seen, 0.01).step(fit.energy(pictures=True), 0.0)
