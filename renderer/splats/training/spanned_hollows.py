"""Cloth hangs where nobody filmed it: the body model alone would show a naked back from beside.

Sides of the trunk that were seen lie where the frames show them. On the far side splats lie on the
body model's skin, hollow above the hips, whatever the person wears. Cloth spans such hollows: from
what stands out above it hangs to what stands out below. It moves away from the camera alone, so
that the outline which frames show stays.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.training.surface_kinds import KINDS
from scene.arrays import Array, Bool, Float, Int

_COLUMNS, _HEIGHTS = 24, 60
"""The trunk's far side, from one flank to the other, and upwards."""
_BESIDE = 2
"""Columns and heights to either side whose means count as a place's own."""
_SURELY_UNSEEN = (0.5, 1.0)
"""Share of unseen splats around from which cloth begins to hang, and hangs free."""
_SPANNED = 0.5
"""Share of a hollow that cloth spans: jeans none of it, a hoodie all."""
_FREELY = 0.8
"""Cosine between the skin's normal and the way that cloth moves from which it hangs free."""
_MOST_M = 0.08
"""How far cloth hangs off the skin at most."""


def spanned(
    rest: Float[Array, "N 3"],
    normals: Float[Array, "N 3"],
    kinds: Int[Array, "N"],
    seen: Bool[Array, "N"],
) -> Float[Array, "N 3"]:
    """How far unseen splats on the trunk's far side move, at rest, m; y points up.

    From flank to flank, the profile of each upright strip becomes its convex hull.

    Args:
        rest: where splats lie now.
        normals: of the body's surface there.
        kinds: index into `KINDS`, as of `surface_kinds`.
    """
    from scipy.ndimage import map_coordinates

    moves, trunk = np.zeros_like(rest), kinds == KINDS.index("trunk")
    towards = normals[trunk & seen].sum(axis=0, dtype=np.float64)[[0, 2]]
    if not towards.any():
        return moves
    x, z = -towards / np.linalg.norm(towards)
    away = np.array([x, 0.0, z])
    far = np.flatnonzero(trunk & (normals @ away > 0.0))
    depth = rest[far] @ away
    place = np.stack(
        [_scaled(rest[far] @ np.array([z, 0.0, -x]), _COLUMNS), _scaled(rest[far, 1], _HEIGHTS)]
    )
    column, height = np.rint(place).astype(int)
    count, total, unseen = (
        _summed_around(np.bincount(column * _HEIGHTS + height, values, _COLUMNS * _HEIGHTS))
        for values in (np.ones(len(far)), depth, ~seen[far])
    )
    gaps = np.stack([_below_hull(total[c], count[c]) for c in range(_COLUMNS)])
    low, high = _SURELY_UNSEEN
    share = np.clip((unseen / np.maximum(count, 1.0) - low) / (high - low), 0.0, 1.0)
    gaps = _summed_around((np.minimum(gaps, _MOST_M) * share).ravel())
    gaps /= _summed_around(np.ones(_COLUMNS * _HEIGHTS))
    # nil where the far side begins, so that nothing gapes there
    faces = np.minimum((normals[far] @ away) / _FREELY, 1.0)
    moved = _SPANNED * faces * map_coordinates(gaps, place, order=1)
    moves[far] = np.where(seen[far], 0.0, moved)[:, None] * away
    return moves


def _scaled(values: Float[Array, "M"], count: int) -> Float[Array, "M"]:
    """To 0 until `count` - 1."""
    return (values - values.min()) / max(float(np.ptp(values)), 1e-6) * (count - 1)


def _summed_around(values: Float[Array, "cells"]) -> Float[Array, "C H"]:
    """Over `_BESIDE` to every side."""
    grid, width = np.pad(values.reshape(_COLUMNS, _HEIGHTS), _BESIDE), 2 * _BESIDE + 1
    windows = np.lib.stride_tricks.sliding_window_view(grid, (width, width))
    return windows.sum(axis=(2, 3))


def _below_hull(total: Float[Array, "H"], count: Float[Array, "H"]) -> Float[Array, "H"]:
    """How far the means of one strip lie below their upper convex hull (Andrew's monotone chain,
    1979); 0 where there are none."""
    there = np.flatnonzero(count)
    profile, hull = total[there] / count[there], list[int]()
    for here, value in enumerate(profile):
        while len(hull) > 1:
            first, last = hull[-2:]
            rise = (profile[last] - profile[first]) * (there[here] - there[first])
            if rise > (value - profile[first]) * (there[last] - there[first]):
                break
            hull.pop()
        hull.append(here)
    gaps = np.zeros(len(total))
    if hull:
        gaps[there] = np.interp(there, there[hull], profile[hull]) - profile
    return gaps
