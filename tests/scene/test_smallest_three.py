"""Packed quaternions: the turn survives, within what the bits allow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.rotations import matrix_to_axis_angle, quaternion_to_matrix
from scene.smallest_three import pack_quaternions, unpack_quaternions

quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 1e-2)
)


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    turn = quaternion_to_matrix(a).T @ quaternion_to_matrix(b)
    return float(np.linalg.norm(matrix_to_axis_angle(turn)))


@pytest.mark.parametrize(("bits", "bound_rad"), [(10, 6e-3), (15, 2e-4)])
@given(wxyz=quaternions)
def test_a_turn_survives(wxyz, bits, bound_rad):
    packed = pack_quaternions(wxyz[None], bits)
    assert 0 <= packed[0] < 1 << (3 * bits + 2)
    assert angle_between(unpack_quaternions(packed, bits)[0], wxyz) < bound_rad


@given(wxyz=quaternions)
def test_both_signs_are_one_turn(wxyz):
    both = unpack_quaternions(pack_quaternions(np.stack([wxyz, -wxyz]), 15), 15)
    assert angle_between(both[0], both[1]) < 1e-4


def test_worked_bits():
    # nothing turned: w is left out (index 0), the others lie in the middle
    (identity,) = pack_quaternions(np.array([[1.0, 0.0, 0.0, 0.0]]), 10)
    assert identity == 512 | 512 << 10 | 512 << 20
    # half a turn about z: index 3, w, x and y in the middle
    (half,) = pack_quaternions(np.array([[0.0, 0.0, 0.0, -2.0]]), 10)
    assert half == 3 << 30 | 512 | 512 << 10 | 512 << 20
