"""The mean body under splats: a head without hair."""

from __future__ import annotations

from functools import cache

import numpy as np

from capture.body.model import load_body_model
from renderer.splats.layout import POSITION
from renderer.splats.training.initialisation import FirstSplats, SurfacePlaces, splats_at
from renderer.splats.training.surface_kinds import surface_kinds
from scene.arrays import Array, Int
from scene.body import Body


@cache
def bald_head() -> tuple[Body, FirstSplats, Int[Array, "N"]]:
    """The mean body, splats on its surface, and their kinds."""
    body = load_body_model().body(np.zeros(5))
    places = SurfacePlaces.even(body, 14_000.0, np.random.default_rng(0))
    first = splats_at(places, body, 1.0 / np.sqrt(14_000.0), 0.2)
    rest = first.parameters[:, POSITION : POSITION + 3]
    return body, first, surface_kinds(rest, first.joints, first.weights, body.skeleton)
