"""Unit quaternions in few bits: the three smaller components, and which one was left out.

q and -q are the same turn, so the left out component, the largest, is taken as positive and follows
from unit length; the others lie within +-1/sqrt(2). Bits, low to high: the three components in the
order wxyz, `bits` each, then two bits with the index of the one left out.
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float, Int

_REACH = 0.5**0.5
"""Largest absolute value of a component that is not the largest."""


def pack_quaternions(wxyz: Float[Array, "*batch 4"], bits: int) -> Int[Array, "*batch"]:
    """`wxyz` (any length but nil) as integers of 3 `bits` + 2 bits."""
    q = np.asarray(wxyz, np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    largest = np.abs(q).argmax(axis=-1)[..., None]
    q = np.where(np.take_along_axis(q, largest, axis=-1) < 0.0, -q, q)
    steps = (1 << bits) - 1
    levels = np.rint((q / _REACH + 1.0) * 0.5 * steps).clip(0, steps).astype(np.int64)
    packed = largest[..., 0].astype(np.int64) << (3 * bits)
    for place, component in enumerate(_others(largest)):
        packed |= np.take_along_axis(levels, component, axis=-1)[..., 0] << (place * bits)
    return packed


def unpack_quaternions(packed: Int[Array, "*batch"], bits: int) -> Float[Array, "*batch 4"]:
    """The unit quaternions wxyz that `pack_quaternions` packed, the largest component positive."""
    steps = (1 << bits) - 1
    largest = (packed >> (3 * bits) & 3)[..., None]
    wxyz = np.zeros((*packed.shape, 4))
    for place, component in enumerate(_others(largest)):
        level = (packed >> (place * bits) & steps)[..., None]
        np.put_along_axis(wxyz, component, (2.0 * level / steps - 1.0) * _REACH, axis=-1)
    left = np.sqrt(np.maximum(0.0, 1.0 - (wxyz**2).sum(axis=-1, keepdims=True)))
    np.put_along_axis(wxyz, largest, left, axis=-1)
    return wxyz


def _others(largest: Int[Array, "*batch 1"]) -> list[Int[Array, "*batch 1"]]:
    """The indices of the three components that are not `largest`, rising."""
    return [place + (place >= largest).astype(np.int64) for place in range(3)]
