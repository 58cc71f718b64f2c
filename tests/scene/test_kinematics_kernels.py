"""Compiled rotations and kinematics, against the plain ones of `scene.rotations` and `Skeleton`."""

from __future__ import annotations

import numpy as np
import pytest

from scene import kinematics_kernels as kernels
from scene import rotations
from scene.environment import placement
from scene.skeleton import JOINT_COUNT, PARENTS, Skeleton


def some_angles(longest_rad: float) -> np.ndarray:
    """Angles about axes all round, and about the frame's own axes either way."""
    rng = np.random.default_rng(0)
    axes = np.concatenate([rng.normal(size=(60, 3)), np.eye(3), -np.eye(3)])
    return longest_rad * axes / np.linalg.norm(axes, axis=1, keepdims=True)


LENGTHS = (0.0, 1e-9, 5e-5, 2e-4, 0.3, 1.7, 2.2, np.pi - 1e-7)


@pytest.mark.parametrize("length_rad", LENGTHS)
def test_angles_become_turns_and_turns_angles(length_rad):
    angles = some_angles(length_rad)
    turns = kernels.axis_angles_to_matrices(angles)
    np.testing.assert_allclose(turns, rotations.axis_angle_to_matrix(angles), atol=1e-15)
    np.testing.assert_allclose(kernels.matrices_to_axis_angles(turns), angles, atol=1e-8)
    np.testing.assert_allclose(
        kernels.matrices_to_axis_angles(turns), rotations.matrix_to_axis_angle(turns), atol=1e-13
    )


def test_half_turns_keep_their_axis():
    angles = some_angles(np.pi)
    turns = rotations.axis_angle_to_matrix(angles)
    back = rotations.axis_angle_to_matrix(kernels.matrices_to_axis_angles(turns))
    np.testing.assert_allclose(back, turns, atol=1e-12)


@pytest.mark.parametrize("length_rad", LENGTHS)
def test_rotations_are_integrated_and_compared_in_their_own_frames(length_rad):
    step, start = (
        some_angles(length_rad),
        kernels.axis_angles_to_matrices(some_angles(1.1)[::-1].copy()),
    )
    end = start @ rotations.axis_angle_to_matrix(0.5 * step)
    np.testing.assert_allclose(
        kernels.integrate_rotations(start, step, 0.5),
        rotations.matrix_to_axis_angle(end),
        atol=1e-12,
    )
    np.testing.assert_allclose(kernels.relative_axis_angles(start, end), 0.5 * step, atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_the_shortest_arc_is_that_of_the_plain_one(share):
    for start, end in kernels.axis_angles_to_matrices(some_angles(2.0)).reshape(-1, 2, 3, 3):
        np.testing.assert_allclose(
            kernels.slerp(start, end, share), rotations.slerp(start, end, share), atol=1e-13
        )


def test_the_smallest_turn_between_directions_is_that_of_the_plain_one():
    rng = np.random.default_rng(1)
    pairs = [*rng.normal(size=(40, 2, 3)), np.ones((2, 3)), [[0.0, 3.0, 0.0], [0.0, -1.0, 0.0]]]
    for start, end in np.array(pairs):
        np.testing.assert_allclose(
            kernels.rotation_between(start, end), rotations.rotation_between(start, end), atol=1e-12
        )


def test_a_body_is_placed_as_its_skeleton_says():
    rng = np.random.default_rng(2)
    skeleton = Skeleton(rng.normal(size=(JOINT_COUNT, 3)))
    angles, root = rng.normal(size=(JOINT_COUNT, 3)), rng.normal(size=3)
    stands = placement(rng.normal(size=3), 0.7)
    pelvis, parents = skeleton.rest_joints[0] + root, np.array(PARENTS)
    np.testing.assert_allclose(
        kernels.skinning(angles, pelvis, skeleton.rest_joints, parents, stands),
        stands @ skeleton.skinning_transforms(angles, root),
        atol=1e-12,
    )
    turned, placed = np.empty((JOINT_COUNT, 3, 3)), np.empty((JOINT_COUNT, 3))
    local = rotations.axis_angle_to_matrix(angles)
    kernels.forward_kinematics(local, pelvis, skeleton.rest_joints, parents, turned, placed)
    joints = skeleton.joint_transforms(angles, root)
    np.testing.assert_allclose(turned, joints[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(placed, joints[:, :3, 3], atol=1e-12)
