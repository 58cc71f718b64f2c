"""A face of its own: found from where landmarks lie in the frames of a known head."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from capture.body.model import load_body_model
from capture.fitting.face_shape import face_landmarks, with_own_face
from scene import Body, Motion, Pose, orbit_camera
from scene.arrays import Array, Float
from scene.body import vertex_normals
from scene.expression import EXPRESSION_NAMES, neutral
from scene.skeleton import JOINT_COUNT, JOINT_NAMES

HEAD = JOINT_NAMES.index("head")
NOSE, CHIN = 4, 199
"""Tip of one and front of the other, among the landmarks."""


def known_body() -> Body:
    return load_body_model().body(np.zeros(5))


def turning_head(frames: int, jaw: float = 0.0) -> Motion:
    """A head that turns by 35 degrees to either side."""
    expression = neutral()
    expression[EXPRESSION_NAMES.index("jaw_open")] = jaw
    poses = []
    for index, yaw in enumerate(np.radians(np.linspace(-35.0, 35.0, frames))):
        angles = np.zeros((JOINT_COUNT, 3))
        angles[HEAD, 1] = yaw
        poses.append(Pose(angles, np.zeros(3), index / 30.0, expression))
    return Motion.from_poses(poses)


def camera_before(body: Body):
    head = body.skeleton.rest_joints[HEAD] + np.array([0.0, 0.08, 0.0])
    return orbit_camera(head, 1.2, 0.0, 0.0, 640, 640, 0.5)


def found_in(body: Body, motion: Motion, noise_px: float = 0.0) -> list[Float[Array, "478 2"]]:
    """Landmarks where the face of `body` shows them; those that are not on the surface at nil."""
    rng, landmarks, faces = np.random.default_rng(3), face_landmarks(), []
    assert body.faces is not None
    for index in range(len(motion)):
        places = landmarks.at(body.posed_vertices(motion.pose(index)), body.faces)
        pixels, _ = camera_before(body).project(places)
        face = np.zeros((478, 2))
        face[landmarks.numbers] = pixels + rng.normal(0.0, noise_px, pixels.shape)
        faces.append(face)
    return faces


def with_long_nose(body: Body) -> Body:
    """Its nose is 8 mm longer, its chin 6 mm lower."""
    landmarks = face_landmarks()
    assert body.rest_vertices is not None
    assert body.faces is not None
    moved = body.rest_vertices.copy()
    for number, by in ((NOSE, [0.0, 0.0, 0.008]), (CHIN, [0.0, -0.006, 0.0])):
        place = landmarks.at(body.rest_vertices, body.faces)[landmarks.numbers == number][0]
        near = np.exp(-0.5 * ((body.rest_vertices - place) ** 2).sum(axis=1) / 0.03**2)
        moved += near[:, None] * np.array(by)
    return replace(body, rest_vertices=moved)


def off_m(body: Body, truth: Body, number: int) -> float:
    landmarks = face_landmarks()
    at = [
        landmarks.at(one.rest_vertices, one.faces)[landmarks.numbers == number][0]
        for one in (body, truth)
        if one.rest_vertices is not None and one.faces is not None
    ]
    return float(np.linalg.norm(at[0] - at[1]))


@pytest.mark.parametrize("jaw", [0.0, 0.6])
def test_a_face_of_its_own_is_found_whatever_the_mouth_does(jaw: float):
    body, truth, motion = known_body(), with_long_nose(known_body()), turning_head(12, jaw)
    faces = found_in(truth, motion, noise_px=1.0)
    found = with_own_face(body, motion, camera_before(body), faces)
    assert off_m(body, truth, NOSE) > 0.007
    assert off_m(found, truth, NOSE) < 0.003
    assert off_m(found, truth, CHIN) < 0.002


def test_the_known_face_stays_as_it_is():
    body, motion = known_body(), turning_head(12)
    found = with_own_face(body, motion, camera_before(body), found_in(body, motion))
    assert found.rest_vertices is not None
    assert np.abs(found.rest_vertices - body.rest_vertices).max() < 1e-4


def test_depth_that_no_frame_shows_is_not_guessed():
    body, truth = known_body(), with_long_nose(known_body())
    straight = Motion.from_poses([Pose.rest(index / 30.0) for index in range(12)])
    found = with_own_face(body, straight, camera_before(body), found_in(truth, straight))
    assert off_m(found, truth, NOSE) > 0.006
    assert off_m(found, truth, CHIN) < 0.003


def test_only_the_head_moves_and_its_back_stays():
    body, truth, motion = known_body(), with_long_nose(known_body()), turning_head(8)
    found = with_own_face(body, motion, camera_before(body), found_in(truth, motion))
    assert found.rest_vertices is not None
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    moved = np.linalg.norm(found.rest_vertices - body.rest_vertices, axis=1)
    assert not moved[body.blend_weights[:, HEAD] == 0.0].any()
    head = body.skeleton.rest_joints[HEAD]
    assert moved[body.rest_vertices[:, 2] < head[2] - 0.05].max() < 1e-3


def test_too_few_faces_change_nothing():
    body, motion = known_body(), turning_head(12)
    faces = [*found_in(with_long_nose(body), motion)[:4], *[None] * 8]
    assert with_own_face(body, motion, camera_before(body), faces) is body


def test_landmarks_lie_on_a_face_that_looks_ahead():
    body, landmarks = known_body(), face_landmarks()
    assert body.rest_vertices is not None
    assert body.faces is not None
    assert len(landmarks.numbers) > 350
    places = landmarks.at(body.rest_vertices, body.faces) - body.skeleton.rest_joints[HEAD]
    normals = landmarks.at(vertex_normals(body.rest_vertices, body.faces), body.faces)
    assert np.abs(places).max() < 0.2
    assert (normals[:, 2] > 0.0).mean() > 0.9
    where = dict(zip(landmarks.numbers.tolist(), places, strict=True))
    assert where[263][0] > 0.03 > -0.03 > where[33][0]  # outer corners of her left and right eye
    assert where[10][1] > where[NOSE][1] > where[CHIN][1]
