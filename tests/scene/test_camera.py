"""Camera conventions: OpenCV axes, pixel centres at +0.5, round trips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene import Camera, InvalidInput, look_at, orbit_camera

WEBCAM_DISTORTION = np.array([-0.21, 0.08, 0.001, -0.0007, -0.01])


def make_camera(distortion=None) -> Camera:
    intrinsics = np.array([[500.0, 0.0, 310.0], [0.0, 510.0, 250.0], [0.0, 0.0, 1.0]])
    pose = look_at((1.0, 1.5, 3.0), (0.0, 1.0, 0.0))
    return Camera(intrinsics, pose, 640, 480, distortion)


def test_axes_are_right_down_forward():
    camera = Camera.from_field_of_view(look_at((0, 1, 3), (0, 1, 0)), 100, 100, 0.8)
    centre, depth = camera.project(np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(centre, [50.0, 50.0])
    assert depth == pytest.approx(3.0)
    # seen from +z, the world's +x is to the right and its +y is up, which is a smaller row
    assert camera.project(np.array([0.5, 1.0, 0.0]))[0][0] > 50.0
    assert camera.project(np.array([0.0, 1.5, 0.0]))[0][1] < 50.0


def test_worked_example_in_pixels():
    identity = np.eye(3, 4)
    intrinsics = np.array([[100.0, 0.0, 32.0], [0.0, 100.0, 24.0], [0.0, 0.0, 1.0]])
    pixel, depth = Camera(intrinsics, identity, 64, 48).project(np.array([0.2, -0.1, 2.0]))
    np.testing.assert_allclose(pixel, [42.0, 19.0])
    assert depth == 2.0


@pytest.mark.parametrize("distortion", [None, WEBCAM_DISTORTION])
@given(st.floats(20, 620), st.floats(20, 460), st.floats(0.5, 10))
def test_unproject_inverts_project(distortion, u, v, depth):
    camera = make_camera(distortion)
    point = camera.unproject(np.array([u, v]), np.array(depth))
    pixel, seen_depth = camera.project(point)
    np.testing.assert_allclose(pixel, [u, v], atol=1e-3)
    assert seen_depth == pytest.approx(depth)


def test_rays_pass_through_pixel_centres():
    camera = make_camera()
    origins, directions = camera.rays()
    pixel, _ = camera.project(origins[7, 11] + 2.0 * directions[7, 11])
    np.testing.assert_allclose(pixel, [11.5, 7.5])
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    np.testing.assert_allclose(origins[0, 0], [1.0, 1.5, 3.0])


def test_resizing_scales_pixels_without_a_shift():
    camera, point = make_camera(), np.array([0.1, 1.2, 0.3])
    small = camera.resized(320, 240)
    np.testing.assert_allclose(small.project(point)[0], camera.project(point)[0] / 2.0)


def test_cropping_moves_pixels_by_the_corner():
    camera, point = make_camera(), np.array([0.1, 1.2, 0.3])
    window = camera.cropped(40, -10, 100, 90)
    np.testing.assert_allclose(window.project(point)[0], camera.project(point)[0] - [40.0, -10.0])
    assert (window.width, window.height) == (100, 90)


def test_orbit_azimuths_face_the_front_and_the_left():
    front = orbit_camera((0, 1, 0), 2.0, 0.0, 0.0, 64, 64)
    left = orbit_camera((0, 1, 0), 2.0, np.pi / 2, 0.0, 64, 64)
    above = orbit_camera((0, 1, 0), 2.0, 0.0, 0.5, 64, 64)
    np.testing.assert_allclose(front.position, [0, 1, 2], atol=1e-12)
    np.testing.assert_allclose(left.position, [2, 1, 0], atol=1e-12)
    assert above.position[1] > 1.0
    assert front.fov_y_rad == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("intrinsics", "message"),
    [
        (np.zeros((3, 3)), "intrinsics must be invertible with positive focal lengths; got det"),
        (np.full((3, 3), np.nan), r"intrinsics must be finite; got nan at index \[0, 0\]"),
        (np.eye(4), "intrinsics must be 3 x 3; got 4 x 4"),
    ],
)
@pytest.mark.usefixtures("unchecked_annotations")
def test_bad_intrinsics_are_refused_with_rule_and_value(intrinsics, message):
    with pytest.raises(InvalidInput, match=message):
        Camera(intrinsics, np.eye(3, 4), 64, 64)


def test_mirroring_world_to_camera_is_refused():
    with pytest.raises(InvalidInput, match=r"must hold a rotation .* got determinant -1"):
        Camera(np.eye(3), np.diag([1.0, 1.0, -1.0, 1.0])[:3], 64, 64)


def test_looking_along_up_is_refused():
    with pytest.raises(InvalidInput, match="must not be nil or parallel to up"):
        look_at((0, 2, 0), (0, 0, 0))


@pytest.mark.parametrize("fov", [0.0, np.pi, -1.0])
def test_impossible_field_of_view_is_refused(fov):
    with pytest.raises(InvalidInput, match="fov_y_rad must be between 0 and pi; got"):
        Camera.from_field_of_view(np.eye(3, 4), 64, 64, fov)


def test_a_camera_is_carried_round_at_one_height_and_distance():
    camera = orbit_camera((0.0, 0.0, 0.0), 2.0, 0.0, 0.0, 96, 96)
    middle = np.array([0.1, 0.2, -0.3])
    there = camera.carried_round(middle, np.radians(40.0))
    before, after = camera.position - middle, there.position - middle
    assert after[1] == pytest.approx(before[1])
    assert np.linalg.norm(after) == pytest.approx(np.linalg.norm(before))
    cosine = before[[0, 2]] @ after[[0, 2]] / (np.linalg.norm(before[[0, 2]]) ** 2)
    assert cosine == pytest.approx(np.cos(np.radians(40.0)))
    np.testing.assert_allclose(there.project(middle)[0], camera.project(middle)[0])
