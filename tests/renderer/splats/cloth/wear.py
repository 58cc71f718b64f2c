"""A short tube round the box of a body, and a model that wears it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.splats.cloth.tubes import Tubes
from renderer.splats.model import SplatModel
from renderer.splats.settings import SplatSettings
from renderer.splats.training.loose_clothes import splats_on_cloth
from tests.renderer.studio import make_model

RINGS, SIDES = 4, 8


def make_tubes(spring: float = 20.0, drag: float = 1.0, smoothing: float = 0.1) -> Tubes:
    """A flared tube that joint 0 carries by its first ring, over a capsule; and a straight one."""
    tubes, rest = [], []
    for number, flare in enumerate((0.3, 0.0)):
        down = np.linspace(0.0, 0.3, RINGS)[:, None]
        angle = -2.0 * np.pi * np.arange(SIDES) / SIDES
        radius = 0.3 + flare * down
        ring = [radius * np.cos(angle), 0.9 - 0.5 * number - down + 0.0 * angle]
        rest.append(np.stack([*ring, radius * np.sin(angle)], axis=2).reshape(-1, 3))
        tubes.append((9 * number, number * RINGS * SIDES, RINGS, SIDES))
    return Tubes(
        np.concatenate(rest),
        np.array(tubes, np.int64),
        np.array([[[0.1, 1.0, 0.0], [0.15, 0.4, 0.0]]]),
        np.array([[0, 9]], np.int64),
        np.array([0.25]),
        np.array([0], np.int64),
        np.array([spring, drag, smoothing]),
    )


def make_loose_model() -> SplatModel:
    """The box of a body with splats on its tubes."""
    model, cloth = make_model(), make_tubes()
    first = splats_on_cloth(cloth, 400.0, SplatSettings(), np.random.default_rng(0))
    count = len(first.parameters)
    first.parameters[:, 10:13] = [0.9, 0.8, 0.1]
    first.parameters[:, 13] = 3.0
    return replace(
        model,
        parameters=np.concatenate([model.parameters, first.parameters]),
        joints=np.concatenate([model.joints, first.joints.astype(np.uint8)]),
        weights=np.concatenate([model.weights, first.weights]),
        seen=np.ones(len(model) + count, bool),
        cloth=cloth,
        quads=np.concatenate([model.quads, first.quads]),
    )
