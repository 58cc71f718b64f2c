"""What pixels move by, against finite differences; steps that bring a pose back."""

from __future__ import annotations

import numpy as np

from renderer.photometry import FREE, Points, displacements, moved_pose
from scene import Camera, Pose
from tests.renderer.field.performer import body, pose, view

CAMERA = view(0.6)


def rigid_points() -> Points:
    """Every 300th vertex, bound to its strongest joint alone."""
    person = body()
    assert person.rest_vertices is not None
    assert person.blend_weights is not None
    picked = np.arange(0, len(person.rest_vertices), 300)
    joints = np.argsort(-person.blend_weights[picked], axis=1)[:, :4].astype(np.uint16)
    weights = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (len(picked), 1))
    return Points(person.rest_vertices[picked].astype(np.float32), joints, weights)


def pixels(points: Points, camera: Camera, moment: Pose) -> np.ndarray:
    transforms = body().skeleton.skinning_transforms(moment.joint_angles, moment.root_translation)
    own = transforms[points.joints[:, 0]]
    return camera.project((own[:, :3, :3] @ points.rest[:, :, None])[..., 0] + own[:, :3, 3])[0]


def test_displacements_match_finite_differences():
    points, moment = rigid_points(), pose(0.4, 0.8)
    shown = np.arange(len(points.rest))
    jacobian = displacements(points, shown, body().skeleton, CAMERA, moment)
    for number in range(0, FREE, 4):
        step = np.zeros(FREE)
        step[number] = 1e-5
        up, down = (pixels(points, CAMERA, moved_pose(moment, s)) for s in (step, -step))
        np.testing.assert_allclose(jacobian[:, :, number], (up - down) / 2e-5, atol=2e-3)
