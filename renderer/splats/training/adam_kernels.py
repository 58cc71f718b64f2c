"""Adam (Kingma & Ba 2015) over the rows that a step has seen; the others keep still.

Adam's steps are as large for a gradient that is all noise as for one that is not. So the three
coordinates of a place share one second moment: frames from one side hardly pull a splat in depth,
and hardly move it then. And what a splat's colour adds to a frame counts for more than nothing only
where enough of the splat shows.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION
from scene.arrays import Array

_EPSILON = 1e-15
_COLOUR_EPSILON = 1e-2
"""Root of a colour's second moment up to which its steps grow with its gradient: that of a pixel
that differs by a hundredth. With less, splats of which a sliver shows take stray colours, which are
seen as spots from other sides."""


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def adam_step(
    parameters: Array,  # [N P] float32, changed
    gradient: Array,  # [N P] float32
    seen: Array,  # [N] float32: contribution of each row to this step
    first: Array,  # [N P] float32, changed
    second: Array,  # [N P] float32, changed
    steps: Array,  # [N] int32, changed: how often each row has moved
    rates: Array,  # [P] float32
    beta1: float,
    beta2: float,
    least_contribution: float,
    log_scale_range: Array,  # [2] float32
) -> None:
    """One step down the gradient, corrected by each row's own count; scales, colours clamped."""
    log_beta1, log_beta2 = math.log(beta1), math.log(beta2)
    for i in numba.prange(parameters.shape[0]):
        if seen[i] <= least_contribution:
            continue
        steps[i] += 1
        moves = np.float64(steps[i])
        correct1 = 1.0 / (1.0 - math.exp(moves * log_beta1))
        correct2 = 1.0 / (1.0 - math.exp(moves * log_beta2))
        for p in range(parameters.shape[1]):
            g = gradient[i, p]
            first[i, p] = beta1 * first[i, p] + (1.0 - beta1) * g
            second[i, p] = beta2 * second[i, p] + (1.0 - beta2) * g * g
        of_place = max(second[i, POSITION], second[i, POSITION + 1], second[i, POSITION + 2])
        for p in range(parameters.shape[1]):
            moment = of_place if p < LOG_SCALE else second[i, p]
            least = _COLOUR_EPSILON if COLOUR <= p < OPACITY else _EPSILON
            step = first[i, p] * correct1 / (math.sqrt(moment * correct2) + least)
            parameters[i, p] -= np.float32(rates[p] * step)
        for p in range(LOG_SCALE, LOG_SCALE + 3):
            parameters[i, p] = min(max(parameters[i, p], log_scale_range[0]), log_scale_range[1])
        for p in range(COLOUR, COLOUR + 3):
            parameters[i, p] = min(max(parameters[i, p], np.float32(0.0)), np.float32(1.0))


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def sum_threads(gradients: Array, total: Array) -> None:
    """Sum the threads' buffers [T N Q] into `total` [N Q], and wipe them for the next step."""
    for i in numba.prange(total.shape[0]):
        for q in range(total.shape[1]):
            value = np.float32(0.0)
            for thread in range(gradients.shape[0]):
                value += gradients[thread, i, q]
                gradients[thread, i, q] = 0.0
            total[i, q] = value
