"""Calibrated cameras of a synthetic rig, whose projections are known, and of the real ones."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.real.calibration import CalibratedCamera, in_capture, read_calibration
from benchmarks.real.cases import CASES
from scene.camera import Camera
from scene.errors import InvalidInput
from tests.shared_data import shared_data

SIZE = (1280, 720)
MIDDLE = (640.0, 360.0)
LENS = np.array([0.18, -0.256, 0.0032, 0.0022, 0.124])
RNG = np.random.default_rng(3)
PERSON = RNG.uniform((-0.4, -0.5, -0.3), (0.4, 0.5, 0.3), (60, 3))
"""Points around the world's origin, m."""


def _camera(
    focal_px: float,
    centre: tuple[float, float],
    turn: tuple[float, float, float],
    away_m: float,
    distortion: np.ndarray | None = None,
) -> CalibratedCamera:
    intrinsics = np.diag([focal_px, focal_px, 1.0])
    intrinsics[:2, 2] = centre
    return CalibratedCamera(
        intrinsics,
        np.zeros(5) if distortion is None else distortion,
        cv2.Rodrigues(np.array(turn))[0],
        np.array([0.05, -0.1, away_m]),
    )


def _seen(camera: CalibratedCamera, world: np.ndarray) -> np.ndarray:
    turn = cv2.Rodrigues(camera.rotation)[0]
    return cv2.projectPoints(world, turn, camera.translation, camera.intrinsics, camera.distortion)[
        0
    ][:, 0]


TRAINED = _camera(650.0, MIDDLE, (0.1, -0.2, 0.0), 1.3)
OTHER = _camera(760.0, (630.0, 372.0), (-0.1, 0.9, 0.05), 1.5)


@pytest.mark.parametrize("scale", [1.0, 0.8, 1.25])
def test_another_camera_sees_in_the_captures_world_what_it_filmed(scale):
    turn, shift = cv2.Rodrigues(np.array([0.3, 0.5, -0.2]))[0], np.array([0.2, 1.0, -0.4])
    in_captures_world = (PERSON - shift) @ turn / scale
    intrinsics = np.array([[650.0, 0.0, MIDDLE[0]], [0.0, 650.0, MIDDLE[1]], [0.0, 0.0, 1.0]])
    translation = (TRAINED.rotation @ shift + TRAINED.translation) / scale
    pose = np.concatenate([TRAINED.rotation @ turn, translation[:, None]], axis=1)
    own = Camera(intrinsics, pose, *SIZE)
    np.testing.assert_allclose(own.project(in_captures_world)[0], _seen(TRAINED, PERSON), atol=1e-6)
    placed = in_capture(own, TRAINED, OTHER, scale, SIZE)
    assert (placed.width, placed.height) == SIZE
    np.testing.assert_allclose(
        placed.project(in_captures_world)[0], _seen(OTHER, PERSON), atol=1e-6
    )


def test_a_principal_point_beside_the_middle_is_made_up_for():
    off_centre = _camera(650.0, (647.0, 392.0), (0.1, -0.2, 0.0), 1.3)
    middle = np.array([[650.0, 0.0, MIDDLE[0]], [0.0, 650.0, MIDDLE[1]], [0.0, 0.0, 1.0]])
    # as a capture does, which takes the middle for the principal point
    _, turn, translation = cv2.solvePnP(PERSON, _seen(off_centre, PERSON), middle, np.zeros(5))
    pose = np.concatenate([cv2.Rodrigues(turn)[0], translation], axis=1)
    placed = in_capture(Camera(middle, pose, *SIZE), off_centre, OTHER, 1.0, SIZE)
    apart = np.linalg.norm(placed.project(PERSON)[0] - _seen(OTHER, PERSON), axis=1)
    assert np.median(apart) < 6.0
    centred = CalibratedCamera(
        middle, off_centre.distortion, off_centre.rotation, off_centre.translation
    )
    naive = in_capture(Camera(middle, pose, *SIZE), centred, OTHER, 1.0, SIZE)
    worse = np.linalg.norm(naive.project(PERSON)[0] - _seen(OTHER, PERSON), axis=1)
    assert np.median(apart) < 0.5 * np.median(worse)


def test_points_and_pictures_lose_the_lens_alike():
    bent = _camera(650.0, (647.0, 392.0), (0.1, -0.2, 0.0), 1.3, LENS)
    straight = CalibratedCamera(bent.intrinsics, np.zeros(5), bent.rotation, bent.translation)
    seen, pinhole = _seen(bent, PERSON), _seen(straight, PERSON)
    assert np.linalg.norm(seen - pinhole, axis=1).max() > 5.0
    np.testing.assert_allclose(bent.undistorted_points(seen), pinhole, atol=0.1)

    farthest = np.linalg.norm(seen - pinhole, axis=1).argmax()
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    x, y = seen[farthest]
    spot = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 18.0).astype(np.float32)
    without = bent.undistorted(spot)
    middle = np.array([(without * columns).sum(), (without * rows).sum()]) / without.sum()
    np.testing.assert_allclose(middle, pinhole[farthest], atol=0.5)


def test_a_picture_without_distortion_stays_itself():
    picture = RNG.uniform(0.0, 1.0, (8, 8)).astype(np.float32)
    assert TRAINED.undistorted(picture) is picture


@pytest.mark.parametrize(
    "case", [case for case in CASES if case.calibration], ids=lambda case: case.name
)
def test_the_cameras_of_every_case_are_calibrated(case):
    path = shared_data(case.calibration)
    for clip in (case.trained, *case.other_cameras):
        camera = read_calibration(path, clip)
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-5)
        assert np.linalg.det(camera.rotation) > 0.0
        assert 300.0 < camera.intrinsics[0, 0] < 3000.0


def test_a_camera_that_is_not_in_the_calibration_is_refused(tmp_path):
    path = tmp_path / "cameras.toml"
    path.write_text("[cameras]\n")
    with pytest.raises(InvalidInput, match=r"must name the camera of 'desk_cam9'"):
        read_calibration(path, "desk_cam9")
    with pytest.raises(InvalidInput, match=r"must name the camera of 'nobody'; got cameras.toml"):
        read_calibration(path, "nobody")
