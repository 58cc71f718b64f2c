"""Light of panoramas: harmonics against sums over every pixel, key lights, exposure."""

from __future__ import annotations

import numpy as np
import pytest

from scene import Environment, InvalidInput, Lighting, lighting_of
from scene.colour import to_linear, to_srgb
from scene.lighting import LUMINANCE, harmonic_basis, panorama_directions, solid_angles

SIZE = (48, 96)


def summed(panorama: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Irradiance over pi, pixel by pixel."""
    directions, angles = panorama_directions(*SIZE), solid_angles(*SIZE)
    facing = np.maximum(np.einsum("hwx,nx->nhw", directions, normals), 0.0)
    return np.einsum("nhw,hw,hwc->nc", facing, np.broadcast_to(angles, SIZE), panorama) / np.pi


def some_normals() -> np.ndarray:
    normals = np.random.default_rng(0).normal(size=(64, 3))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_harmonics_are_orthonormal_over_the_sphere():
    basis = harmonic_basis(panorama_directions(*SIZE).reshape(-1, 3))
    angles = np.broadcast_to(solid_angles(*SIZE), SIZE).reshape(-1, 1)
    np.testing.assert_allclose((basis * angles).T @ basis, np.eye(9), atol=5e-3)


def test_the_same_light_from_everywhere_shades_nothing():
    light = lighting_of(np.full((*SIZE, 3), [0.5, 0.4, 0.3]))
    np.testing.assert_allclose(light.shading(some_normals()), [[0.5, 0.4, 0.3]] * 64, rtol=1e-3)
    assert not light.key_colour.any()


def test_nine_numbers_and_a_key_light_are_near_the_sum_over_all_pixels():
    directions = panorama_directions(*SIZE)
    panorama = 0.3 + 0.2 * directions[..., 1:2] * np.array([0.5, 0.7, 1.0])
    lamp = np.array([0.6, 0.5, 0.62]) / np.linalg.norm([0.6, 0.5, 0.62])
    panorama[directions @ lamp > 0.99] = [60.0, 50.0, 40.0]
    light, truth = lighting_of(panorama), summed(panorama, some_normals())
    assert light.key_direction @ lamp > 0.999
    assert (light.key_colour > 0.5).all()
    error = np.abs(light.shading(some_normals()) - truth)
    assert error.max() < 0.03 * truth.max()


def test_exposure_brings_the_best_lit_side_to_white():
    panorama = np.full((*SIZE, 3), 3.0)
    panorama[:10] = 20.0
    place = Environment.of_panorama("bright", panorama)
    assert place.panorama is not None
    assert place.lighting is not None
    assert (summed(place.panorama, some_normals()) @ LUMINANCE).max() == pytest.approx(
        1.0, abs=0.05
    )


def test_a_turned_panorama_turns_its_light():
    panorama = np.full((*SIZE, 3), 0.2)
    panorama[20:28, 60:66] = 40.0
    straight = Environment.of_panorama("a", panorama).lighting
    turned = Environment.of_panorama("a", panorama, np.pi / 2.0).lighting
    assert straight is not None
    assert turned is not None
    x, y, z = straight.key_direction
    np.testing.assert_allclose(turned.key_direction, [z, y, -x], atol=0.02)


@pytest.mark.parametrize(
    ("panorama", "words"),
    [
        (np.ones((8, 8, 3)), "twice as wide as high.*8 x 8"),
        (-np.ones((8, 16, 3)), "must not be negative anywhere; got -1"),
        (np.zeros((8, 16, 3)), "must give light; got a mean radiance of 0"),
    ],
)
def test_what_is_no_panorama_is_said(panorama, words):
    with pytest.raises(InvalidInput, match=words):
        lighting_of(panorama)


def test_a_key_direction_is_of_unit_length():
    with pytest.raises(InvalidInput, match="unit length; got length 2"):
        Lighting(np.zeros((9, 3)), np.array([0.0, 2.0, 0.0]), np.ones(3))


def test_srgb_round_trip():
    values = np.linspace(0.0, 1.0, 256)
    np.testing.assert_allclose(to_srgb(to_linear(values)), values, atol=1e-9)
    assert to_linear(np.array(0.5)) == pytest.approx(0.2140, abs=1e-4)
