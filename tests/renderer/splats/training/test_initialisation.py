"""First splats: even over the surface; capsules cut by the masks where there is no surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.splats.layout import LOG_SCALE, ROTATION
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats, sample_surface
from scene import Body, InvalidInput, Skeleton
from scene.rotations import quaternion_to_matrix
from tests.renderer.studio import make_body, make_sequence


def test_points_are_spread_by_area_and_lie_on_the_surface():
    points, normals, weights, area = sample_surface(make_body(), 4000, np.random.default_rng(0))
    assert area == pytest.approx(2 * (0.4 * 1.6 + 0.2 * 1.6 + 0.4 * 0.2))
    on_face = np.isclose(np.abs(points[:, 0]), 0.2) | np.isclose(np.abs(points[:, 2]), 0.1)
    on_face |= np.isclose(points[:, 1], 0.0) | np.isclose(points[:, 1], 1.6)
    assert on_face.all()
    front = np.isclose(points[:, 2], 0.1).mean()
    assert front == pytest.approx(0.64 / area, abs=0.02)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)


def test_splats_follow_at_most_four_joints():
    first = first_splats(
        make_sequence(), SplatSettings(count=500, most=500), np.random.default_rng(0)
    )
    assert first.parameters.shape == (500, 14)
    assert first.joints.shape == (500, 4)
    np.testing.assert_allclose(first.weights.sum(axis=1), 1.0, rtol=1e-6)


def test_splats_lie_flat_in_the_surface():
    settings = SplatSettings(count=500, most=500)
    first = first_splats(make_sequence(), settings, np.random.default_rng(0))
    quaternions = first.parameters[:, ROTATION : ROTATION + 4].astype(np.float64)
    turns = quaternion_to_matrix(quaternions)
    np.testing.assert_allclose(turns[:, :, 2], first.normals, atol=1e-6)
    scales = np.exp(first.parameters[:, LOG_SCALE : LOG_SCALE + 3])
    np.testing.assert_allclose(scales[:, 2], settings.thickness * scales[:, 0], rtol=1e-5)


def test_without_a_surface_capsules_are_cut_by_the_masks():
    sequence = make_sequence()
    joints_only = replace(sequence, body=Body(sequence.body.skeleton))
    first = first_splats(joints_only, SplatSettings(count=300, most=300), np.random.default_rng(0))
    camera, pose = sequence.train.camera(0), sequence.train.pose(0)
    transforms = sequence.body.skeleton.skinning_transforms(
        pose.joint_angles, pose.root_translation
    )
    moved = transforms[first.joints[:, 0]]
    posed = np.einsum("nij,nj->ni", moved[:, :3, :3], first.parameters[:, :3]) + moved[:, :3, 3]
    pixels = camera.project(posed)[0].astype(int).clip(0, 47)
    assert (sequence.train.mask(0)[pixels[:, 1], pixels[:, 0]] > 0.5).mean() > 0.85


def test_a_skeleton_beside_its_masks_is_refused():
    sequence = make_sequence()
    beside = Body(Skeleton(np.add(sequence.body.skeleton.rest_joints, (5.0, 0.0, 0.0))))
    with pytest.raises(InvalidInput, match="masks must cover the skeleton; got"):
        first_splats(
            replace(sequence, body=beside),
            SplatSettings(count=50, most=50),
            np.random.default_rng(0),
        )
