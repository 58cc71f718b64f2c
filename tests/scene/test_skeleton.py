"""Forward kinematics and skinning against values worked by hand."""

from __future__ import annotations

import numpy as np
import pytest

from scene import JOINT_NAMES, PARENTS, Body, InvalidInput, Pose, Skeleton

LEFT_SHOULDER, LEFT_ELBOW, LEFT_WRIST = (
    JOINT_NAMES.index(name) for name in ("left_shoulder", "left_elbow", "left_wrist")
)


def make_skeleton() -> Skeleton:
    """Every bone 0.1 m long and along +x, the pelvis 1 m up: easy to work by hand."""
    rest = np.zeros((24, 3))
    rest[0] = [0.0, 1.0, 0.0]
    for joint in range(1, 24):
        rest[joint] = rest[PARENTS[joint]] + [0.1, 0.0, 0.0]
    return Skeleton(rest)


def test_rest_pose_is_the_rest():
    skeleton = make_skeleton()
    joints = skeleton.joint_transforms(np.zeros((24, 3)), np.zeros(3))
    np.testing.assert_allclose(joints[:, :3, 3], skeleton.rest_joints)
    skinning = skeleton.skinning_transforms(np.zeros((24, 3)), np.zeros(3))
    np.testing.assert_allclose(skinning, np.broadcast_to(np.eye(4), (24, 4, 4)), atol=1e-15)


def test_elbow_bent_by_a_quarter_turn():
    skeleton = make_skeleton()
    angles = np.zeros((24, 3))
    angles[LEFT_ELBOW] = [0.0, 0.0, np.pi / 2]
    joints = skeleton.joint_transforms(angles, np.array([0.0, 0.0, 0.5]))[:, :3, 3]
    # chain: spine1-3, collar, shoulder, elbow = 6 bones of 0.1 m, then the wrist turns up to +y
    np.testing.assert_allclose(joints[LEFT_ELBOW], [0.6, 1.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(joints[LEFT_WRIST], [0.6, 1.1, 0.5], atol=1e-12)


def test_rotations_accumulate_down_the_chain():
    skeleton = make_skeleton()
    angles = np.zeros((24, 3))
    angles[LEFT_SHOULDER] = angles[LEFT_ELBOW] = [0.0, 0.0, np.pi / 2]
    joints = skeleton.joint_transforms(angles, np.zeros(3))[:, :3, 3]
    np.testing.assert_allclose(joints[LEFT_ELBOW], [0.5, 1.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(joints[LEFT_WRIST], [0.4, 1.1, 0.0], atol=1e-12)


def test_global_orientation_turns_about_the_pelvis():
    skeleton = make_skeleton()
    angles = np.zeros((24, 3))
    angles[0] = [0.0, np.pi, 0.0]
    joints = skeleton.joint_transforms(angles, np.zeros(3))[:, :3, 3]
    np.testing.assert_allclose(joints[0], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(joints[1], [-0.1, 1.0, 0.0], atol=1e-12)


def test_skinning_carries_joints_to_their_posed_places():
    skeleton, rng = make_skeleton(), np.random.default_rng(1)
    angles, root = rng.normal(size=(5, 24, 3)), rng.normal(size=(5, 3))
    joints = skeleton.joint_transforms(angles, root)
    skinning = skeleton.skinning_transforms(angles, root)
    moved = skinning[..., :3, :3] @ skeleton.rest_joints[:, :, None]
    np.testing.assert_allclose(moved[..., 0] + skinning[..., :3, 3], joints[..., :3, 3], atol=1e-12)


def make_body(weights) -> Body:
    vertices = np.array([[0.65, 1.0, 0.0], [0.65, 1.02, 0.0], [0.65, 1.0, 0.02]])
    return Body(make_skeleton(), vertices, np.array([[0, 1, 2]]), weights)


def test_linear_blend_skinning_averages_transforms():
    weights = np.zeros((3, 24))
    weights[:, LEFT_SHOULDER] = weights[:, LEFT_ELBOW] = 0.5
    angles = np.zeros((24, 3))
    angles[LEFT_ELBOW] = [0.0, 0.0, np.pi / 2]
    posed = make_body(weights).posed_vertices(Pose(angles, np.zeros(3)))
    # half stays at (0.65, 1), half turns about the elbow (0.6, 1) to (0.6, 1.05)
    np.testing.assert_allclose(posed[0], [0.625, 1.025, 0.0], atol=1e-12)


def test_blend_weights_must_sum_to_one():
    with pytest.raises(InvalidInput, match="blend_weights must sum to one a vertex; got a sum off"):
        make_body(np.full((3, 24), 0.5))


def test_surface_parts_come_together():
    with pytest.raises(InvalidInput, match="must be given together; got"):
        Body(make_skeleton(), rest_vertices=np.zeros((3, 3)))


def test_posing_joints_only_is_refused():
    with pytest.raises(InvalidInput, match="must have a surface to be posed; got joints only"):
        Body(make_skeleton()).posed_vertices(Pose.rest())


def test_nan_in_a_pose_is_named_by_its_place():
    angles = np.zeros((24, 3))
    angles[3, 1] = np.nan
    with pytest.raises(InvalidInput, match=r"joint_angles must be finite; got nan at index \[3, 1"):
        Pose(angles, np.zeros(3))


def test_parents_must_precede_children():
    with pytest.raises(InvalidInput, match="parents must name one earlier joint"):
        Skeleton(np.zeros((2, 3)), ("a", "b"), (-1, 1))


def test_the_ground_is_under_the_lower_foot_of_most_frames():
    skeleton = make_skeleton()
    angles, root = np.zeros((10, 24, 3)), np.zeros((10, 3))
    root[:, 1] = 0.25
    root[0, 1], root[7:, 1] = -0.5, 1.0  # one bad frame, then a jump
    angles[4, JOINT_NAMES.index("left_hip"), 2] = 0.5 * np.pi  # lifts a leg that points along +x
    assert skeleton.ground_height(angles, root) == pytest.approx(0.25)
