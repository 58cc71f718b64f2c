"""The studio by the light of a panorama: exact sums, and pictures that follow them."""

from __future__ import annotations

import numpy as np
import pytest

from capture.errors import CaptureError
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.light import EnvironmentLight
from scene import Environment, lighting_of
from scene.lighting import panorama_directions


def sunset(height: int = 32) -> np.ndarray:
    """A low sun towards +x over a dim ground."""
    directions = panorama_directions(height, 2 * height)
    panorama = np.where(directions[..., 1:2] > 0.0, [0.3, 0.4, 0.6], [0.1, 0.1, 0.05])
    panorama[directions @ np.array([0.98, 0.199, 0.0]) > 0.995] = [90.0, 70.0, 40.0]
    return panorama


def test_even_light_leaves_albedo_as_it_is():
    light = EnvironmentLight(np.ones((16, 32, 3)))
    normals = np.random.default_rng(0).normal(size=(50, 3))
    albedo = np.random.default_rng(1).uniform(size=(50, 3))
    np.testing.assert_allclose(light.shade(albedo, normals), albedo, atol=5e-3)


def test_the_sum_agrees_with_harmonics_and_a_key_light():
    normals = np.random.default_rng(2).normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    summed, nine = EnvironmentLight(sunset()), lighting_of(sunset())
    truth = summed.shading(normals)
    assert np.abs(truth - nine.shading(normals)).max() < 0.04 * truth.max()
    # across the seam behind -x as well
    seam = np.array([[-1.0, 0.0, 1e-6], [-1.0, 0.0, -1e-6]])
    np.testing.assert_allclose(*summed.shading(seam), rtol=1e-3)


def test_a_performer_is_lit_from_where_the_sun_is(tmp_path):
    pictures = []
    for turn_rad in (0.0, np.pi):
        place = Environment.of_panorama("sunset", sunset(), turn_rad)
        out = tmp_path / f"clip{turn_rad:.0f}"
        make_sequence(
            out, look="lit", environment=place, frames=1, size=64, test_cameras=4, turn_deg=0.0
        )
        clip = open_sequence(out)
        pictures.append(clip.train.image(0).mean(axis=2))
    mask = clip.train.mask(0) > 0.9
    rows, columns = np.nonzero(mask[: np.nonzero(mask.any(axis=1))[0][0] + 8])
    cheeks = [columns <= columns.min() + 1, columns >= columns.max() - 1]
    left, right = ((rows[cheek], columns[cheek]) for cheek in cheeks)
    # the camera stands at +z: +x is on its right
    assert pictures[0][right].mean() > 1.5 * pictures[1][right].mean()
    assert pictures[1][left].mean() > 1.5 * pictures[0][left].mean()


def test_a_light_needs_the_look_that_shows_it(tmp_path):
    place = Environment.of_panorama("sunset", sunset())
    for look, environment in (("plain", place), ("lit", Environment())):
        with pytest.raises(CaptureError, match="panorama and go with the look lit; got look"):
            make_sequence(tmp_path / "clip", look=look, environment=environment)
