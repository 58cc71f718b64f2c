"""Rotations of a motion packet, compiled; `scene.smallest_three` is the twin. float64."""

from __future__ import annotations

import math

import numba

from scene.arrays import Array

_STEPS = (1 << 15) - 1
_REACH = math.sqrt(0.5)
_LONGEST = 0.751
"""Of three components, squared, none of which is larger than the one left out."""


@numba.njit(cache=True)
def unpack_rotations(packed: Array, rotations: Array) -> bool:
    """Write the rotations [J 3 3] in `packed` [6 J] uint8; False where one is none."""
    q = [0.0, 0.0, 0.0, 0.0]
    for joint in range(len(rotations)):
        bits, at = 0, 6 * joint
        for byte in range(6):
            bits |= int(packed[at + byte]) << (8 * byte)
        largest, place, square = (bits >> 45) & 3, 0, 0.0
        for component in range(4):
            if component == largest:
                continue
            level = (bits >> (15 * place)) & _STEPS
            q[component] = (2.0 * level / _STEPS - 1.0) * _REACH
            square += q[component] * q[component]
            place += 1
        if square > _LONGEST:
            return False
        q[largest] = math.sqrt(1.0 - square)
        w, x, y, z = q[0], q[1], q[2], q[3]
        out = rotations[joint]
        out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
        out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
        out[2, 2] = 1.0 - 2.0 * (x * x + y * y)
        out[0, 1], out[1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
        out[0, 2], out[2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
        out[1, 2], out[2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)
    return True
