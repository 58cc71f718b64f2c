"""Position-based dynamics of tubes of cloth, and their outlines.

Letters: V vertices of all tubes, tube by tube, ring by ring from the top; G tubes; C capsules; S
steps; F frames; T triangles.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.cloth.constants import GRAVITY, ROUNDS
from scene.arrays import Array


@numba.njit(nogil=True, cache=True)
def step(
    current: Array,  # [V 3] float64, world, m; replaced
    previous: Array,  # [V 3] float64, a step before; replaced
    transforms: Array,  # [K 4 4] float64: skinning transforms, rest -> world
    rest: Array,  # [V 3] float64
    lengths: Array,  # [V] float64: of the link up to the ring above, m
    tubes: Array,  # [G 4] int64: joint, first vertex, rings, sides
    ends: Array,  # [C 2 3] float64: ends of the capsules at rest
    movers: Array,  # [C 2] int64: joint that moves each end
    radii: Array,  # [C] float64, m
    owners: Array,  # [C] int64: the tube that a capsule pushes
    constants: Array,  # [3] float64: of `Tubes`
    step_s: float,
) -> None:
    """Move the cloth on by one step of `step_s`.

    Vertices are drawn to where the joint alone would take them, keep their speed but for the drag,
    fall, take on the mean offset of their neighbours on the ring, keep the lengths of their threads
    and are pushed out of capsules.
    """
    spring, drag, smoothing = constants
    for g in range(tubes.shape[0]):
        joint, first, rings, sides = tubes[g]
        share = min(0.5, smoothing * (sides / 32.0) ** 2)
        m = transforms[joint]
        offset = np.empty((sides, 3))
        for r in range(rings):
            at = first + r * sides
            for a in range(sides):
                v = at + a
                for x in range(3):
                    target = (
                        m[x, 0] * rest[v, 0] + m[x, 1] * rest[v, 1] + m[x, 2] * rest[v, 2] + m[x, 3]
                    )
                    pull = spring * (target - current[v, x])
                    if x == 1:
                        pull += GRAVITY
                    ahead = (
                        current[v, x]
                        + (1.0 - drag * step_s) * (current[v, x] - previous[v, x])
                        + step_s * step_s * pull
                    )
                    previous[v, x] = current[v, x]
                    offset[a, x] = ahead - target
                    current[v, x] = target
            if r == 0:
                continue
            for a in range(sides):
                before, after = (a - 1) % sides, (a + 1) % sides
                for x in range(3):
                    mean = 0.5 * (offset[before, x] + offset[after, x])
                    current[at + a, x] += (1.0 - share) * offset[a, x] + share * mean
    for _ in range(ROUNDS):
        for g in range(tubes.shape[0]):
            _keep_lengths(current, lengths, tubes[g])
        for c in range(ends.shape[0]):
            _push_out(current, transforms, tubes[owners[c]], ends[c], movers[c], radii[c])


@numba.njit(nogil=True, cache=True)
def _keep_lengths(current: Array, lengths: Array, tube: Array) -> None:
    """Even links first, then odd ones; each end moves by half, but for the first ring."""
    _, first, rings, sides = tube
    for parity in range(2):
        for r in range(parity, rings - 1, 2):
            upper_share = 0.0 if r == 0 else 0.5
            lower_share = 1.0 - upper_share
            for a in range(sides):
                u = first + r * sides + a
                v = u + sides
                x = current[v, 0] - current[u, 0]
                y = current[v, 1] - current[u, 1]
                z = current[v, 2] - current[u, 2]
                excess = 1.0 - lengths[v] / max(math.sqrt(x * x + y * y + z * z), 1e-9)
                current[u, 0] += upper_share * excess * x
                current[u, 1] += upper_share * excess * y
                current[u, 2] += upper_share * excess * z
                current[v, 0] -= lower_share * excess * x
                current[v, 1] -= lower_share * excess * y
                current[v, 2] -= lower_share * excess * z


@numba.njit(nogil=True, cache=True)
def _push_out(
    current: Array, transforms: Array, tube: Array, ends: Array, movers: Array, radius: float
) -> None:
    """Vertices of `tube` inside a capsule go to its surface, but for the first ring."""
    a, b = np.empty(3), np.empty(3)
    for x in range(3):
        m, n = transforms[movers[0]], transforms[movers[1]]
        a[x] = m[x, 0] * ends[0, 0] + m[x, 1] * ends[0, 1] + m[x, 2] * ends[0, 2] + m[x, 3]
        b[x] = n[x, 0] * ends[1, 0] + n[x, 1] * ends[1, 1] + n[x, 2] * ends[1, 2] + n[x, 3]
        b[x] -= a[x]
    length2 = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    _, first, rings, sides = tube
    for v in range(first + sides, first + rings * sides):
        x, y, z = current[v, 0] - a[0], current[v, 1] - a[1], current[v, 2] - a[2]
        along = min(1.0, max(0.0, (x * b[0] + y * b[1] + z * b[2]) / length2))
        x, y, z = x - along * b[0], y - along * b[1], z - along * b[2]
        distance2 = x * x + y * y + z * z
        if distance2 >= radius * radius:
            continue
        grow = radius / max(math.sqrt(distance2), 1e-6) - 1.0
        current[v, 0] += grow * x
        current[v, 1] += grow * y
        current[v, 2] += grow * z


@numba.njit(nogil=True, cache=True)
def simulate(
    current: Array,  # as of `step`
    previous: Array,
    transforms: Array,  # [S K 4 4] float64
    rest: Array,
    lengths: Array,
    tubes: Array,
    ends: Array,
    movers: Array,
    radii: Array,
    owners: Array,
    constants: Array,
    step_s: float,
    settling: int,  # steps in the first pose before the rest
    out: Array,  # [S V 3] float64
) -> None:
    """`step` for each of `transforms`; where the cloth is after each."""
    for s in range(-settling, transforms.shape[0]):
        step(
            current, previous, transforms[max(s, 0)], rest, lengths, tubes, ends, movers, radii,
            owners, constants, step_s,
        )  # fmt: skip
        if s >= 0:
            out[s] = current


@numba.njit(nogil=True, cache=True)
def cover(
    pixels: Array,  # [V 2] float64, px
    triangles: Array,  # [T 3] int32
    covered: Array,  # [H W] uint8; set to 1 inside
) -> None:
    """Fill the pixels whose centres lie in a triangle."""
    height, width = covered.shape
    for t in range(triangles.shape[0]):
        p, q, r = triangles[t]
        px, py = pixels[p, 0], pixels[p, 1]
        qx, qy = pixels[q, 0] - px, pixels[q, 1] - py
        rx, ry = pixels[r, 0] - px, pixels[r, 1] - py
        area = qx * ry - qy * rx
        if abs(area) < 1e-9:
            continue
        left = max(0, math.floor(px + min(0.0, qx, rx)))
        right = min(width - 1, math.ceil(px + max(0.0, qx, rx)))
        top = max(0, math.floor(py + min(0.0, qy, ry)))
        bottom = min(height - 1, math.ceil(py + max(0.0, qy, ry)))
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                x, y = column + 0.5 - px, row + 0.5 - py
                u = (x * ry - y * rx) / area
                v = (qx * y - qy * x) / area
                if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
                    covered[row, column] = 1
