"""A step of cloth as its rules say it, one vertex at a time: the twin to trust.

Twin of `renderer.splats.cloth.simulation_kernels`. Slow on purpose.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.cloth.constants import GRAVITY, ROUNDS
from renderer.splats.cloth.tubes import STEP_S, Tubes
from scene.arrays import Array, Float


def step(
    cloth: Tubes,
    current: Float[Array, "V 3"],
    previous: Float[Array, "V 3"],
    transforms: Float[Array, "K 4 4"],
) -> Float[Array, "V 3"]:
    """Where `cloth` is a step after `current`, before which it was `previous`."""
    spring, drag, smoothing = cloth.constants
    target = cloth.at_rest(transforms)
    fall = np.array([0.0, GRAVITY, 0.0])
    kept = 1.0 - drag * STEP_S
    pulled = spring * (target - current) + fall
    offset = current + kept * (current - previous) + STEP_S**2 * pulled - target
    moved = target.copy()
    for _, first, rings, sides in cloth.tubes:
        share = min(0.5, smoothing * (sides / 32.0) ** 2)
        for ring in range(1, rings):
            at = first + ring * sides
            for side in range(sides):
                before, after = at + (side - 1) % sides, at + (side + 1) % sides
                mean = 0.5 * (offset[before] + offset[after])
                moved[at + side] += (1.0 - share) * offset[at + side] + share * mean
    for _ in range(ROUNDS):
        for tube in cloth.tubes:
            _keep_lengths(moved, cloth.lengths, tube)
        for capsule, owner in enumerate(cloth.owners):
            _push_out(moved, cloth, transforms, capsule, cloth.tubes[owner])
    return moved


def _keep_lengths(moved: Array, lengths: Array, tube: Array) -> None:
    _, first, rings, sides = tube
    for ring in [*range(0, rings - 1, 2), *range(1, rings - 1, 2)]:
        for side in range(sides):
            upper, lower = first + ring * sides + side, first + (ring + 1) * sides + side
            link = moved[lower] - moved[upper]
            excess = link * (1.0 - lengths[lower] / np.linalg.norm(link))
            moved[upper] += (0.0 if ring == 0 else 0.5) * excess
            moved[lower] -= (1.0 if ring == 0 else 0.5) * excess


def _push_out(moved: Array, cloth: Tubes, transforms: Array, capsule: int, tube: Array) -> None:
    start, end = (
        transforms[joint][:3, :3] @ place + transforms[joint][:3, 3]
        for joint, place in zip(cloth.movers[capsule], cloth.ends[capsule], strict=True)
    )
    bone = end - start
    _, first, rings, sides = tube
    for vertex in range(first + sides, first + rings * sides):
        along = np.clip((moved[vertex] - start) @ bone / (bone @ bone), 0.0, 1.0)
        nearest = start + along * bone
        away = moved[vertex] - nearest
        distance = np.linalg.norm(away)
        if distance < cloth.radii[capsule]:
            moved[vertex] = nearest + away * (cloth.radii[capsule] / distance)
