"""Poses move to where pixels and priors agree; exact ones are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.pose_refinement.bundle_adjustment import ClipNormalEquations
from renderer.pose_refinement.clip_poses import PoseRefinement
from renderer.pose_refinement.photometry import POSE_PARAMETERS, SHARED_PARAMETERS
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from tests.renderer.studio import make_motion, make_sequence

FRAMES = 6


def make_refinement() -> PoseRefinement:
    motion = make_motion(FRAMES)
    angles = motion.joint_angles + 0.3 * np.random.default_rng(0).normal(size=(24, 3))
    claimed = replace(motion, joint_angles=angles)
    return PoseRefinement(make_sequence(exact=False, motion=claimed, frames=FRAMES))


def asking_for(steps: np.ndarray) -> ClipNormalEquations:
    """Pixels that are sure of `steps` [F 75] and know nothing of bones."""
    size = POSE_PARAMETERS + SHARED_PARAMETERS
    matrices, vectors = np.zeros((FRAMES, size, size)), np.zeros((FRAMES, size))
    matrices[:, np.arange(POSE_PARAMETERS), np.arange(POSE_PARAMETERS)] = 1e4
    vectors[:, :POSE_PARAMETERS] = 1e4 * steps
    return ClipNormalEquations(matrices, vectors, 1e-3)


def test_poses_go_where_sure_pixels_say():
    refinement, wanted = make_refinement(), np.zeros((FRAMES, POSE_PARAMETERS))
    before = refinement.motion()
    wanted[:, 3 * 16 + 1] = 0.05 * np.array([1.0, -1.0, 0.5, -0.5, 1.0, -1.0])
    refinement.apply_step(asking_for(wanted))
    turns = axis_angle_to_matrix(wanted[:, :-3].reshape(FRAMES, 24, 3))
    expected = matrix_to_axis_angle(axis_angle_to_matrix(before.joint_angles) @ turns)
    np.testing.assert_allclose(refinement.motion().joint_angles, expected, atol=2e-3)
    np.testing.assert_allclose(
        refinement.motion().root_translation, before.root_translation, atol=2e-3
    )


def test_what_all_frames_ask_for_alike_they_get():
    refinement, wanted = make_refinement(), np.zeros((FRAMES, POSE_PARAMETERS))
    wanted[:, 3 * 16 + 1], wanted[:, POSE_PARAMETERS - 1] = 0.05, 0.02
    before = refinement.motion()
    refinement.apply_step(asking_for(wanted))
    turned = axis_angle_to_matrix(refinement.motion().joint_angles[:, 16])
    expected = axis_angle_to_matrix(before.joint_angles[:, 16]) @ axis_angle_to_matrix(
        np.array([0.0, 0.05, 0.0])
    )
    np.testing.assert_allclose(turned, expected, atol=3e-3)
    shift = refinement.motion().root_translation - before.root_translation
    np.testing.assert_allclose(shift, np.tile([0.0, 0.0, 0.02], (FRAMES, 1)), atol=2e-3)


def test_longer_bones_reach_the_skeleton():
    refinement = make_refinement()
    equations = asking_for(np.zeros((FRAMES, POSE_PARAMETERS)))
    femur = POSE_PARAMETERS + 2
    equations.matrices[:, femur, femur] = 1e6
    equations.vectors[:, femur] = 0.02 * 1e6
    before = refinement.skeleton.rest_joints
    refinement.apply_step(equations)
    longer = refinement.skeleton.rest_joints - before
    # the shin's and the foot's joints follow the knee; nothing else moves
    np.testing.assert_allclose(longer[4], 0.0202 * (before[4] - before[1]), rtol=0.1)
    np.testing.assert_allclose(longer[[7, 10]], longer[[4, 4]], atol=1e-12)
    np.testing.assert_allclose(longer[[0, 1, 2, 3, 9]], 0.0, atol=1e-12)


def test_exact_poses_stay():
    sequence = make_sequence(exact=True)
    refinement = PoseRefinement(sequence)
    assert not refinement.active
    assert refinement.motion() is sequence.motion


def test_state_is_restored():
    refinement = make_refinement()
    before, stood = refinement.state(), refinement.transforms(1).copy()
    refinement.apply_step(
        asking_for(0.05 * np.random.default_rng(0).normal(size=(FRAMES, POSE_PARAMETERS)))
    )
    assert np.abs(stood - refinement.transforms(1)).max() > 1e-3
    refinement.restore(before)
    np.testing.assert_array_equal(stood, refinement.transforms(1))
