"""How far a guess may stand out before a frame shows that nobody is there.

What lies outside an outline is not the person, from wherever it is seen: the body is within the
visual hull of all its outlines (Laurentini, The Visual Hull Concept, PAMI 1994).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from renderer.splats.layout import POSITION
from renderer.splats.training.neighbours import mean_of_neighbours
from renderer.splats.training.views import View
from scene.arrays import Array, Float

_STEPS = 8
"""Shares of the way that are tried."""
_OUTSIDE = 0.2
"""Share of the frames whose pictures hold a place that must show nobody there: poses are a little
off, and masks have holes."""
_TAPERED_ROUNDS = 4
"""In which no splat stands out farther than the mean of those beside it."""


def share_within_outlines(
    surface: Float[Array, "N P"],
    joints: Array,
    weights: Float[Array, "N 4"],
    moves: Float[Array, "N 3"],
    widths_m: Float[Array, "N"],
    frames: Iterable[tuple[View, Float[Array, "K 4 4"]]],
) -> Float[Array, "N"]:
    """How much of each of `moves` splats may go, 0 to 1, so that they end within the outlines.

    Args:
        surface: where splats begin, at rest; they follow `joints` [N 4] by `weights`.
        moves: at rest, m.
        widths_m: from the middle of a splat to where it ends.
        frames: with the transforms that pose the body in them.
    """
    lengths = np.linalg.norm(moves, axis=1, keepdims=True)
    ends = widths_m[:, None] * moves / np.maximum(lengths, 1e-9)
    shares = np.linspace(0.0, 1.0, _STEPS + 1)[1:]
    shown, outside = np.zeros((2, _STEPS, len(moves)))
    for view, transforms in frames:
        for step, share in enumerate(shares):
            moved = surface.copy()
            moved[:, POSITION : POSITION + 3] += share * moves + ends
            inside, nobody = _looked_up(view, moved, joints, weights, transforms)
            shown[step] += inside
            outside[step] += inside & nobody
    fits = np.logical_and.accumulate(outside <= _OUTSIDE * shown, axis=0)
    allowed = fits.sum(axis=0) / _STEPS
    if len(moves) < 2:
        return allowed
    mean = mean_of_neighbours(surface[:, POSITION : POSITION + 3])
    for _ in range(_TAPERED_ROUNDS):
        allowed = np.minimum(allowed, mean @ allowed)
    return allowed


def _looked_up(
    view: View,
    surface: Float[Array, "N P"],
    joints: Array,
    weights: Float[Array, "N 4"],
    transforms: Float[Array, "K 4 4"],
) -> tuple[Array, Array]:
    """Of each splat [N]: whether the picture holds it, and whether it shows nobody there."""
    from renderer.splats.training.beside_kernels import pose_surface

    places, normals = np.empty((2, len(surface), 3), np.float32)
    pose_surface(surface, np.zeros_like(places), joints, weights, transforms, places, normals)
    pixels, inside, _ = view.pixels_at(places)
    return inside, pixels[..., 3] < 128
