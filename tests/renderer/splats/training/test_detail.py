"""Where frames show the body, and how many splats that is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.splats.settings import SplatSettings
from renderer.splats.training.detail import shown_density
from renderer.splats.training.initialisation import SurfacePlaces, splat_density
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.sequence import Sequence
from tests.renderer.studio import SIZE, make_sequence


class _Frames:
    """The first frame of a sequence, `finer` times as large."""

    def __init__(self, sequence: Sequence, finer: int = 1) -> None:
        self._source, self._finer = sequence.train, finer

    def __len__(self) -> int:
        return 1

    def camera(self, index: int) -> Camera:
        camera = self._source.camera(index)
        return camera.resized(self._finer * camera.width, self._finer * camera.height)

    def pose(self, index: int) -> Pose:
        return self._source.pose(index)

    def image(self, index: int) -> np.ndarray:
        return np.kron(self._source.image(index), np.ones((self._finer, self._finer, 1)))

    def mask(self, index: int) -> np.ndarray:
        return np.kron(self._source.mask(index), np.ones((self._finer, self._finer)))


def _from_one_side(finer: int = 1) -> Sequence:
    sequence = make_sequence()
    motion = Motion.from_poses([sequence.train.pose(0)])
    return replace(sequence, train=_Frames(sequence, finer), motion=motion)


def _areas_and_normals(sequence: Sequence) -> tuple[np.ndarray, np.ndarray]:
    body = sequence.body
    assert body.rest_vertices is not None
    corners = body.rest_vertices[body.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(normal, axis=1)
    return areas, normal / (2.0 * areas[:, None])


def test_a_side_that_no_frame_shows_has_no_density_and_the_other_that_of_its_pixels():
    sequence = _from_one_side()
    density, (_, normals) = shown_density(sequence), _areas_and_normals(sequence)
    camera = sequence.train.camera(0)
    towards = camera.position / np.linalg.norm(camera.position)
    assert (density[normals @ towards < -0.9] == 0.0).all()
    front = density[normals @ towards > 0.9]
    assert front.size
    distance = np.linalg.norm(camera.position - [0.0, 0.8, 0.0])
    assert np.sqrt(front.max()) == pytest.approx(camera.focal_px / distance, rel=0.25)


def test_pictures_twice_as_fine_show_four_times_the_pixels():
    once, twice = (shown_density(_from_one_side(finer)) for finer in (1, 2))
    np.testing.assert_allclose(twice, 4.0 * once, rtol=1e-9)


def test_count_follows_the_pixels_between_its_bounds():
    sequence = _from_one_side()
    areas, _ = _areas_and_normals(sequence)
    settings = replace(
        SplatSettings(), count=10, most=10**6, unseen_density=0.0, pixels_a_splat=2.0
    )
    count, density = splat_density(sequence, settings)
    assert count == pytest.approx((areas * shown_density(sequence)).sum() / 2.0, abs=1.0)
    assert splat_density(sequence, replace(settings, pixels_a_splat=1.0))[0] == pytest.approx(
        2 * count, abs=1
    )
    assert splat_density(sequence, replace(settings, count=count + 7))[0] == count + 7
    assert splat_density(sequence, replace(settings, most=count - 7))[0] == count - 7
    assert density.min() == 0.0


def test_pixels_count_at_the_size_in_which_steps_see_whole_frames():
    once, large = _from_one_side(), _from_one_side(finer=3)
    settings = replace(SplatSettings(), count=10, unseen_density=0.0, whole_px=SIZE)
    expected = splat_density(once, settings)[0]
    assert splat_density(large, settings)[0] == pytest.approx(expected, abs=1)
    larger = replace(settings, whole_px=3 * SIZE)
    assert splat_density(large, larger)[0] == pytest.approx(9 * expected, rel=0.02)


def test_most_splats_lie_where_frames_look():
    sequence = _from_one_side()
    settings = replace(SplatSettings(), count=4000, most=4000, unseen_density=2.0)
    count, density = splat_density(sequence, settings)
    places = SurfacePlaces.drawn(sequence.body, count, density, np.random.default_rng(0))
    seen = shown_density(sequence)[places.face] > 0.0
    assert seen.mean() > 0.9
    assert not seen.all()
    assert places.spacing[seen].max() < places.spacing[~seen].min()
