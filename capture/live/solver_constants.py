"""What a page that solves poses has to know of people in general, as one file.

Little endian, without gaps: f32 of the pose prior, `mean` [24 3], `axes` [24 3 3] and `stiffness`
[24 3] (1 / deviation^2); f32 `landmarks` [33 3] of the mean body at rest and `head` [33 3], points
of a face that expressions hardly move, from the head's joint, m; then the lifter's weights, f16, in
the order of `WEIGHTS`. `client/src/motion/constants.ts` reads it.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from capture.body.landmarks import load_body_landmarks
from capture.detection.lifter import BLOCKS, WEIGHTS_FILE
from capture.detection.rigid_parts import rest_points

_LAYERS = [
    f"blocks.{block}.{half}.{layer}"
    for block in range(BLOCKS)
    for half in range(2)
    for layer in ("linear", "norm")
]
WEIGHTS = (
    "mean",
    "deviation",
    *(f"{name}.{part}" for name in ("first", *_LAYERS, "last") for part in ("weight", "bias")),
)
"""Of `capture.detection.lifter`, in the file's order."""


@cache
def solver_constants() -> bytes:
    """The file."""
    from capture.body.pose_prior import pose_prior  # imports torch

    prior = pose_prior()
    people = (
        prior.mean.numpy(),
        prior.axes.numpy(),
        prior.deviation.numpy().astype(np.float64) ** -2,
        load_body_landmarks().rest,
        rest_points("head"),
    )
    with np.load(WEIGHTS_FILE) as file:
        weights = [file[name].astype("<f2").tobytes() for name in WEIGHTS]
    return b"".join([*(one.astype("<f4").tobytes() for one in people), *weights])
