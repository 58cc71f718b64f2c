"""Draw the splats that a step has moved towards the surface and their neighbours, in place."""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from scene.arrays import Array

_F = np.float32


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def pull_to_surface(
    parameters: Array,  # [N P] float32, changed
    surface: Array,  # [N P] float32
    shares: Array,  # [N] float32: of the difference that is taken back
    strength: float,  # of all shares
    moved: Array,  # [N] bool
) -> None:
    """Places, sizes and rotations."""
    for i in numba.prange(parameters.shape[0]):
        if moved[i]:
            share = _F(strength) * shares[i]
            for p in range(POSITION, ROTATION + 4):
                parameters[i, p] += share * (surface[i, p] - parameters[i, p])


@numba.njit(inline="always", fastmath=True)
def _off_surface(parameters, surface, normals, i):
    off = _F(0.0)
    for k in range(3):
        off += (parameters[i, POSITION + k] - surface[i, POSITION + k]) * normals[i, k]
    return off


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def off_surface(
    parameters: Array,  # [N P] float32
    surface: Array,  # [N P] float32
    normals: Array,  # [N 3] float32
    off: Array,  # [N] float32, written, m
) -> None:
    """How far splats lie off the surface along its normal."""
    for i in numba.prange(parameters.shape[0]):
        off[i] = _off_surface(parameters, surface, normals, i)


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def pull_to_neighbours(
    parameters: Array,  # [N P] float32, changed
    surface: Array,  # [N P] float32
    normals: Array,  # [N 3] float32
    neighbourhood: Array,  # [N] float32: how far it lies off the surface, m
    free: Array,  # [N] bool: those that stay
    roughness: float,  # how far a splat may stand out, m
    share: float,  # of what stands out farther that is taken back
    moved: Array,  # [N] bool
) -> None:
    """Places, along the normal."""
    for i in numba.prange(parameters.shape[0]):
        if not moved[i] or free[i]:
            continue
        gap = neighbourhood[i] - _off_surface(parameters, surface, normals, i)
        gap -= min(max(gap, -_F(roughness)), _F(roughness))
        for k in range(3):
            parameters[i, POSITION + k] += _F(share) * gap * normals[i, k]


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def mean_of_neighbours(
    starts: Array,  # [N + 1] int32, where each row of a sparse matrix begins
    columns: Array,  # [E] int32
    shares: Array,  # [E] float32
    values: Array,  # [N C] float32
    mean: Array,  # [N C] float32, written
) -> None:
    """The matrix times `values`."""
    for i in numba.prange(values.shape[0]):
        mean[i] = _F(0.0)
        for e in range(starts[i], starts[i + 1]):
            for c in range(values.shape[1]):
                mean[i, c] += shares[e] * values[columns[e], c]


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def pull_hands(
    parameters: Array,  # [N P] float32, changed
    surface: Array,  # [N P] float32
    rows: Array,  # [M] int64: the splats of hands
    own: Array,  # [M 6] float32: colours, and places off the surface, m
    around: Array,  # [M 6] float32: the same of the neighbourhood
    roughness: float,  # how far a splat may stand out, m
    pulls: Array,  # [3] float32: shares that are taken back of colours, places and shapes
    moved: Array,  # [N] bool
) -> None:
    """Colours and places to the neighbourhood's, the rest to the surface's."""
    for m in numba.prange(rows.shape[0]):
        i = rows[m]
        if not moved[i]:
            continue
        length = _F(0.0)
        for k in range(3):
            length += (around[m, 3 + k] - own[m, 3 + k]) ** 2
        length = max(math.sqrt(length), _F(1e-9))
        too_far = max(_F(1.0) - _F(roughness) / length, _F(0.0))
        for k in range(3):
            parameters[i, COLOUR + k] += pulls[0] * (around[m, k] - own[m, k])
            parameters[i, POSITION + k] += pulls[1] * too_far * (around[m, 3 + k] - own[m, 3 + k])
        for p in range(LOG_SCALE, ROTATION + 4):
            parameters[i, p] += pulls[2] * (surface[i, p] - parameters[i, p])
        parameters[i, OPACITY] += pulls[2] * (surface[i, OPACITY] - parameters[i, OPACITY])
