"""What pixels move by, against finite differences; steps that bring a pose back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.pose_refinement.photometry import (
    POSE_PARAMETERS,
    SHARED_PARAMETERS,
    SkinnedPoints,
    apply_pose_step,
    log_bone_ratios,
    pixel_equations,
    with_bone_lengths,
)
from scene import Camera, Pose, Skeleton
from tests.renderer.field.performer import body, pose, view

CAMERA = view(0.6)


def rigid_points() -> SkinnedPoints:
    """Every 300th vertex, bound to its strongest joint alone."""
    person = body()
    assert person.rest_vertices is not None
    assert person.blend_weights is not None
    picked = np.arange(0, len(person.rest_vertices), 300)
    joints = np.argsort(-person.blend_weights[picked], axis=1)[:, :4].astype(np.uint16)
    weights = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (len(picked), 1))
    return SkinnedPoints(person.rest_vertices[picked].astype(np.float32), joints, weights)


def pixels(
    points: SkinnedPoints, camera: Camera, moment: Pose, skeleton: Skeleton | None = None
) -> np.ndarray:
    """Where the points are seen; they stay where they are on the bones of `skeleton`."""
    given = body().skeleton
    bones = skeleton or given
    transforms = bones.skinning_transforms(moment.joint_angles, moment.root_translation)
    own, joint = transforms[points.joints[:, 0]], points.joints[:, 0]
    rest = points.rest + (bones.rest_joints - given.rest_joints)[joint]
    return camera.project((own[:, :3, :3] @ rest[:, :, None])[..., 0] + own[:, :3, 3])[0]


def pixel_jacobian(points: SkinnedPoints, moment: Pose, *, shared: bool) -> np.ndarray:
    """[N 2 D] of a pixel for each point."""
    return np.stack(
        [
            [
                pixel_equations(
                    points,
                    np.array([shown]),
                    np.eye(2)[None],
                    along[None],
                    body().skeleton,
                    CAMERA,
                    moment,
                    shared=shared,
                )[1]
                for along in np.eye(2)
            ]
            for shown in range(len(points.rest))
        ]
    )


def test_displacements_match_finite_differences():
    points, moment = rigid_points(), pose(0.4, 0.8)
    jacobian = pixel_jacobian(points, moment, shared=False)
    for number in range(0, POSE_PARAMETERS, 4):
        step = np.zeros(POSE_PARAMETERS)
        step[number] = 1e-5
        up, down = (pixels(points, CAMERA, apply_pose_step(moment, s)) for s in (step, -step))
        np.testing.assert_allclose(jacobian[:, :, number], (up - down) / 2e-5, atol=2e-3)


def test_what_the_clip_shares_moves_pixels_as_finite_differences_say():
    points, moment = rigid_points(), pose(0.4, 0.8)
    jacobian = pixel_jacobian(points, moment, shared=True)
    assert jacobian.shape[2] == POSE_PARAMETERS + SHARED_PARAMETERS
    for number in range(SHARED_PARAMETERS):
        step = np.zeros(SHARED_PARAMETERS)
        step[number] = 1e-5
        up, down = (
            pixels(
                points, longer_lens(CAMERA, s[-1]), moment, with_bone_lengths(body().skeleton, s)
            )
            for s in (step, -step)
        )
        expected = (up - down) / 2e-5
        assert number == 7 or np.abs(expected).max() > 1.0
        np.testing.assert_allclose(
            jacobian[:, :, POSE_PARAMETERS + number], expected, atol=2e-3, rtol=1e-4
        )


def test_equations_are_sums_over_pixels_that_several_joints_move():
    rng, rigid, moment = np.random.default_rng(0), rigid_points(), pose(0.4, 0.8)
    points = replace(rigid, weights=rng.dirichlet(np.ones(4), len(rigid.rest)))
    jacobian = pixel_jacobian(points, moment, shared=True)
    shown = rng.integers(0, len(points.rest), 500)
    root, along = rng.normal(size=(500, 2, 2)), rng.normal(size=(500, 2))
    tensors = root @ np.swapaxes(root, 1, 2)
    matrix, vector = pixel_equations(
        points, shown, tensors, along, body().skeleton, CAMERA, moment, shared=True
    )
    own = jacobian[shown]
    expected = np.einsum("pri,prs,psj->ij", own, tensors, own)
    np.testing.assert_allclose(matrix, expected, atol=1e-9 * np.abs(expected).max())
    expected = np.einsum("pri,pr->i", own, along)
    np.testing.assert_allclose(vector, expected, atol=1e-9 * np.abs(expected).max())


def longer_lens(camera: Camera, step: float) -> Camera:
    """`camera` with the logarithm of its focal length changed by `step`."""
    intrinsics = camera.intrinsics.copy()
    intrinsics[[0, 1], [0, 1]] *= np.exp(step)
    return replace(camera, intrinsics=intrinsics)


def test_how_bones_were_stretched_is_read_off_them():
    step = np.append(np.random.default_rng(0).normal(0.0, 0.05, SHARED_PARAMETERS - 1), 0.0)
    first = body().skeleton
    np.testing.assert_allclose(
        log_bone_ratios(first, with_bone_lengths(first, step)), step, atol=1e-9
    )
