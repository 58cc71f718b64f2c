"""Poses move to where pixels and priors agree; exact ones are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.pose_refinement.bundle_adjustment import ClipNormalEquations
from renderer.pose_refinement.clip_poses import PoseRefinement
from renderer.pose_refinement.photometry import POSE_PARAMETERS, SHARED_PARAMETERS
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import PoseTrust
from tests.renderer.studio import make_model, make_motion, make_sequence

FRAMES = 6


def make_refinement(trust: PoseTrust = PoseTrust.ESTIMATED) -> PoseRefinement:
    motion = make_motion(FRAMES)
    angles = motion.joint_angles + 0.3 * np.random.default_rng(0).normal(size=(24, 3))
    claimed = replace(motion, joint_angles=angles)
    return PoseRefinement(make_sequence(trust=trust, motion=claimed, frames=FRAMES))


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


def test_given_poses_follow_pixels_but_for_what_is_the_same_in_all_frames():
    refinement, wanted = make_refinement(PoseTrust.GIVEN), np.zeros((FRAMES, POSE_PARAMETERS))
    before, skeleton = refinement.motion(), refinement.skeleton
    own = 0.02 * np.array([1.0, -1.0, 0.5, -0.5, 1.0, -1.0])
    wanted[:, 3 * 16 + 1], wanted[:, POSE_PARAMETERS - 1] = 0.05 + own, 0.02
    equations = asking_for(wanted)
    femur = POSE_PARAMETERS + 2
    equations.matrices[:, femur, femur] = 1e6
    equations.vectors[:, femur] = 0.02 * 1e6
    refinement.apply_step(equations)
    after = refinement.motion()
    was, turned = (axis_angle_to_matrix(m.joint_angles[:, 16]) for m in (before, after))
    steps = matrix_to_axis_angle(np.swapaxes(was, -1, -2) @ turned)
    np.testing.assert_allclose(steps[:, 1], own, atol=2e-3)
    shift = after.root_translation - before.root_translation
    np.testing.assert_allclose(shift, 0.0, atol=1e-3)
    np.testing.assert_allclose(shift.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_array_equal(refinement.skeleton.rest_joints, skeleton.rest_joints)


def test_given_poses_come_back():
    refinement = make_refinement(PoseTrust.GIVEN)
    before = [refinement.transforms(frame).copy() for frame in range(FRAMES)]
    steps = 0.03 * np.random.default_rng(0).normal(size=(FRAMES, POSE_PARAMETERS))
    refinement.apply_step(asking_for(steps))
    for frame in range(FRAMES):
        np.testing.assert_array_equal(refinement.given_transforms(frame), before[frame])
    refinement.go_back()
    np.testing.assert_array_equal(refinement.transforms(2), before[2])


@pytest.mark.parametrize("trust", [PoseTrust.GIVEN, PoseTrust.ESTIMATED])
def test_an_earlier_model_of_the_clip_brings_its_skeleton_unless_poses_are_given(trust):
    sequence, model = make_sequence(trust=trust, frames=FRAMES), make_model()
    longer = replace(model.skeleton, rest_joints=1.1 * model.skeleton.rest_joints)
    start = replace(model, skeleton=longer, data_hash=sequence.data_hash, motion=sequence.motion)
    own = sequence.body.skeleton if trust is PoseTrust.GIVEN else longer
    assert PoseRefinement(sequence, start).skeleton is own


def test_exact_poses_stay():
    sequence = make_sequence(trust=PoseTrust.EXACT)
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
