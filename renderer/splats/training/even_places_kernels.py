"""Leaves out the most crowded of some places, again and again."""

from __future__ import annotations

import heapq

import numba
import numpy as np

from scene.arrays import Array


@numba.njit(nogil=True, cache=True)
def eliminate(
    starts: Array,  # [M + 1] int: where each place's neighbours begin
    neighbours: Array,  # [E] int
    crowding: Array,  # [E] float64: of a place by that neighbour, and the other way round
    crowded: Array,  # [M] float64: the sums, changed
    count: int,  # of places that are kept
) -> Array:  # [M] bool: which these are
    kept = np.ones(len(crowded), np.bool_)
    heap = [(-crowded[place], place) for place in range(len(crowded))]
    heapq.heapify(heap)
    left = len(crowded)
    while left > count:
        value, place = heapq.heappop(heap)
        if -value > crowded[place]:
            # neighbours have gone since
            heapq.heappush(heap, (-crowded[place], place))
            continue
        kept[place] = False
        left -= 1
        for edge in range(starts[place], starts[place + 1]):
            crowded[neighbours[edge]] -= crowding[edge]
    return kept
