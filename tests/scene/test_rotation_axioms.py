"""Rotations form a group: closure, inverse, log and exp, near identity and near pi too."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.rotations import (
    axis_angle_to_matrix,
    axis_angle_to_quaternion,
    matrix_to_axis_angle,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_between,
    slerp,
)

unit_axes = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 1e-2)
    .map(lambda v: v / np.linalg.norm(v))
)
angles = st.one_of(
    st.floats(0, np.pi - 1e-6),
    st.floats(-7, -2).map(lambda e: 10.0**e),  # near identity
    st.floats(-6, -3).map(lambda e: np.pi - 10.0**e),  # near pi
)
rotation_vectors = st.builds(lambda axis, angle: axis * angle, unit_axes, angles)


@given(rotation_vectors)
def test_matrix_is_a_rotation(axis_angle):
    matrix = axis_angle_to_matrix(axis_angle)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-12)


@given(rotation_vectors)
def test_quaternions_of_axis_angles_are_those_of_their_matrices(axis_angle):
    wxyz = axis_angle_to_quaternion(axis_angle)
    assert wxyz[0] >= 0.0
    assert np.linalg.norm(wxyz) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(
        quaternion_to_matrix(wxyz), axis_angle_to_matrix(axis_angle), atol=1e-12
    )


@given(rotation_vectors)
def test_log_inverts_exp(axis_angle):
    back = matrix_to_axis_angle(axis_angle_to_matrix(axis_angle))
    np.testing.assert_allclose(back, axis_angle, atol=2e-8)


@given(rotation_vectors)
def test_opposite_vector_is_the_inverse(axis_angle):
    product = axis_angle_to_matrix(axis_angle) @ axis_angle_to_matrix(-axis_angle)
    np.testing.assert_allclose(product, np.eye(3), atol=1e-12)


@given(rotation_vectors)
def test_quaternion_round_trips_with_w_not_negative(axis_angle):
    matrix = axis_angle_to_matrix(axis_angle)
    wxyz = matrix_to_quaternion(matrix)
    assert wxyz[0] >= 0.0
    assert np.linalg.norm(wxyz) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(quaternion_to_matrix(wxyz), matrix, atol=1e-12)


@given(rotation_vectors, rotation_vectors)
def test_composition_is_closed(a, b):
    product = axis_angle_to_matrix(a) @ axis_angle_to_matrix(b)
    again = axis_angle_to_matrix(matrix_to_axis_angle(product))
    np.testing.assert_allclose(again, product, atol=1e-7)


@given(rotation_vectors, st.floats(0, 1))
def test_slerp_turns_at_constant_pace(axis_angle, fraction):
    end = axis_angle_to_matrix(axis_angle)
    part = matrix_to_axis_angle(slerp(np.eye(3), end, fraction))
    np.testing.assert_allclose(part, fraction * axis_angle, atol=3e-8)


@given(unit_axes, unit_axes)
def test_rotation_between_maps_start_to_end(start, end):
    matrix = rotation_between(start, end)
    np.testing.assert_allclose(matrix @ start, end, atol=1e-7)
    angle = np.linalg.norm(matrix_to_axis_angle(matrix))
    expected = np.arctan2(np.linalg.norm(np.cross(start, end)), np.dot(start, end))
    assert angle == pytest.approx(expected, abs=1e-6)


def test_rotation_between_opposite_directions_is_a_half_turn():
    matrix = rotation_between(np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0]))
    np.testing.assert_allclose(matrix @ [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_quarter_turn_about_z_takes_x_to_y():
    matrix = axis_angle_to_matrix(np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(matrix @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_batches_and_dtypes_are_kept(shape, dtype):
    axis_angle = np.random.default_rng(0).normal(size=(*shape, 3)).astype(dtype)
    matrix = axis_angle_to_matrix(axis_angle)
    assert matrix.shape == (*shape, 3, 3)
    assert matrix.dtype == dtype
    back = matrix_to_axis_angle(matrix)
    assert back.dtype == dtype
    np.testing.assert_allclose(axis_angle_to_matrix(back), matrix, atol=1e-5)
