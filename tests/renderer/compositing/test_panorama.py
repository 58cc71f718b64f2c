"""Places behind people: the kernel against its twin, floors under feet, people in their light."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.compositing.panorama_kernels import DOME_RADIUS_M, PANORAMA_HEIGHT_M, compose_panorama
from renderer.reference import panorama as twin
from renderer.scene_renderer import SceneRenderer, panorama_picture
from scene import Environment, Performer, Pose, Scene, orbit_camera
from scene.camera import Camera, look_at
from scene.colour import to_linear
from scene.lighting import panorama_directions
from tests.renderer.studio import make_model

SIZE = (64, 128)


def place(picture: np.ndarray) -> Environment:
    return Environment.of_panorama("place", picture)


def spots() -> np.ndarray:
    """Smooth colours all round, another wherever one looks."""
    x, y, z = np.moveaxis(panorama_directions(*SIZE), -1, 0)
    return np.stack([0.5 + 0.4 * x, 0.5 + 0.4 * y, 0.5 + 0.4 * z], axis=-1)


@pytest.mark.parametrize("azimuth", [0.0, 1.5, 3.1, 4.7])
@pytest.mark.parametrize("elevation", [-0.3, 0.15, 1.2])
def test_the_kernel_matches_its_twin(azimuth, elevation):
    camera = orbit_camera((0.1, 1.0, 0.0), 3.0, azimuth, elevation, 72, 48, 1.2)
    rng = np.random.default_rng(0)
    rgba = rng.uniform(0, 0.7, (48, 72, 4)).astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:]
    shadows = np.array([[0.1, -0.2, 0.3, 0.5], [0.5, 0.4, 0.2, 0.3]], np.float32)
    picture = panorama_picture(place(spots()))
    out = np.zeros((48, 72, 3), np.uint8)
    view = (camera.intrinsics, camera.rotation, camera.position)
    compose_panorama(out, rgba, *view, picture, shadows, np.ones((3, 5), bool))
    slow = twin.compose_panorama(rgba, camera, picture[:, :-1], shadows)
    assert np.abs(out.astype(int) - slow.astype(int)).max() <= 2


def test_from_where_it_was_taken_a_panorama_is_seen_as_it_is():
    eye = (0.0, PANORAMA_HEIGHT_M, 0.0)
    camera = Camera.from_field_of_view(
        look_at(eye, (1.0, PANORAMA_HEIGHT_M + 0.3, 0.4)), 64, 64, 0.8
    )
    environment = place(spots())
    assert environment.panorama is not None
    seen = SceneRenderer().render(Scene(environment, ()), camera)
    _, directions = camera.rays()
    truth = 0.5 + 0.4 * directions
    gain = environment.panorama.max() / spots().max()
    np.testing.assert_allclose(to_linear(seen / 255.0), np.minimum(truth * gain, 1.0), atol=0.02)


def test_the_floor_stays_under_the_feet_while_viewers_walk():
    directions = panorama_directions(*SIZE)
    mark = np.array([1.0, -PANORAMA_HEIGHT_M, 0.5])
    mark /= np.linalg.norm(mark)
    ground = np.full((*SIZE, 3), 0.1)
    ground[directions @ mark > 0.995] = 0.5
    environment = Environment(panorama=ground)
    for azimuth in (0.0, 2.0, 4.0):
        camera = orbit_camera((0.0, 0.5, 0.0), 4.0, azimuth, 0.5, 96, 96, 0.9)
        seen = SceneRenderer().render(Scene(environment, ()), camera).mean(axis=2)
        pixel, _ = camera.project(np.array([1.0, 0.0, 0.5]))
        rows, columns = np.nonzero(seen > 0.95 * seen.max())
        assert np.hypot(columns.mean() + 0.5 - pixel[0], rows.mean() + 0.5 - pixel[1]) < 3.0


def test_people_are_lit_by_the_place_and_hide_it():
    bright, dim = place(np.full((*SIZE, 3), 1.0)), np.full((*SIZE, 3), 0.02)
    dim[panorama_directions(*SIZE)[..., 2] < -0.9] = 3.0  # a window at their backs
    camera = orbit_camera((0.0, 0.8, 0.0), 4.0, 0.0, 0.05, 96, 96)
    somebody = Performer("one", make_model(), np.zeros(3), 0.0, Pose.rest())
    middle = (slice(44, 54), slice(44, 52))
    lit = SceneRenderer().render(Scene(bright, (somebody,)), camera)[middle].copy()
    against = SceneRenderer().render(Scene(place(dim), (somebody,)), camera)[middle].copy()
    empty = SceneRenderer().render(Scene(bright, ()), camera)[middle]
    assert lit.max() > 2.0 * against.max()
    assert np.abs(lit.astype(int) - empty.astype(int)).max() > 60


def test_a_viewer_outside_the_dome_gets_a_picture():
    camera = orbit_camera((0.0, 0.8, 0.0), 3.0 * DOME_RADIUS_M, 0.4, 0.3, 32, 32)
    assert SceneRenderer().render(Scene(place(spots()), ()), camera).std() > 0.0
