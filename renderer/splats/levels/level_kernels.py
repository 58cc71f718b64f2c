"""From a model's splats to those that stand for several of them.

Letters: as in `renderer.splats.levels.tree`; C numbers a splat.
"""

from __future__ import annotations

import numba

from scene.arrays import Array


@numba.njit(nogil=True, cache=True)
def average_upwards(
    values: Array,  # [M C] float32: of the finest known, of all others written
    split: Array,  # [J] int32
    first_share: Array,  # [J] float32
    roots: int,
) -> None:
    """Give each node that splits the mean of its two, the last split first."""
    for j in range(split.shape[0] - 1, -1, -1):
        first = roots + 2 * j
        share = first_share[j]
        for c in range(values.shape[1]):
            values[split[j], c] = share * values[first, c] + (1.0 - share) * values[first + 1, c]
