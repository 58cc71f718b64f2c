"""What a picture shows that the model shows as well is left to the model."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.live_look.coring import cored, exposure_beside
from renderer.live_look.picture import WebcamPicture
from scene import Pose, orbit_camera
from scene.arrays import Array, Float

SIDE = 128
CAMERA = orbit_camera((0.0, 0.0, 0.0), 2.0, 0.0, 0.0, SIDE, SIDE)
PERSON = slice(24, 104)
"""Rows and columns that show somebody."""
AS_IT_IS = np.ones(3, np.float32)


def person(rgb: tuple[float, float, float] | Float[Array, "80 80 3"]) -> Float[Array, "S S 4"]:
    """What a model comes to, premultiplied: a square in `rgb`."""
    drawn = np.zeros((SIDE, SIDE, 4), np.float32)
    drawn[PERSON, PERSON, :3] = rgb
    drawn[PERSON, PERSON, 3] = 1.0
    return drawn


def picture_of(drawn: Float[Array, "S S 4"]) -> WebcamPicture:
    rgb, matte = ((255.0 * of + 0.5).astype(np.uint8) for of in (drawn[..., :3], drawn[..., 3]))
    return WebcamPicture(rgb, matte, CAMERA, Pose.rest())


def checks(side: int) -> Float[Array, "80 80 3"]:
    """Dark and light squares."""
    row = np.arange(80) // side % 2
    return (0.2 + 0.6 * (row[:, None] ^ row)[..., None] * np.ones(3)).astype(np.float32)


def news(picture: WebcamPicture, drawn: Float[Array, "S S 4"]) -> Float[Array, "80 80"]:
    """How far the person is to come from the model's colours."""
    wanted = cored(picture, drawn, AS_IT_IS)
    return np.abs(wanted - drawn)[PERSON, PERSON, :3].max(axis=-1)


def test_what_coding_leaves_is_no_news():
    drawn = person(checks(8))
    noisy = drawn.copy()
    noise = np.random.default_rng(0).uniform(-0.05, 0.05, (80, 80, 3))
    noisy[PERSON, PERSON, :3] += noise
    assert news(picture_of(noisy), drawn).max() < 1e-6


def test_a_pose_that_is_a_pixel_off_is_no_news():
    drawn = person(checks(8))
    moved = np.roll(drawn, 1, axis=(0, 1))
    assert news(picture_of(moved), drawn).max() < 1e-6


def test_another_colour_is_taken_as_it_is_but_for_the_rim():
    drawn, now = person((0.5, 0.5, 0.5)), person((0.5, 0.5, 0.8))
    wanted = cored(picture_of(now), drawn, AS_IT_IS)
    np.testing.assert_allclose(wanted[40:88, 40:88, 2], 0.8, atol=1.0 / 255.0)
    np.testing.assert_array_equal(wanted[PERSON, 24, 2], 0.5)
    np.testing.assert_array_equal(wanted[..., 3], picture_of(now).known())


def test_a_gap_of_the_model_that_the_picture_closes_is_no_colour_of_what_is_beside_it():
    """A slit between arm and trunk, through which a white wall was cut out with the person."""
    drawn, now = person((0.3, 0.3, 0.3)), person((0.3, 0.3, 0.3))
    drawn[:, 60:63] = 0.0
    now[PERSON, 59:64, :3] = 1.0
    wanted = cored(picture_of(now), drawn, AS_IT_IS)
    beside = wanted[PERSON][:, [59, 63]]
    np.testing.assert_allclose(beside[..., :3], 0.3, atol=1e-6)


def test_what_is_new_is_taken_with_its_outline():
    drawn, now = person((0.5, 0.5, 0.5)), person((0.5, 0.5, 0.5))
    now[60:66, 60:66, :3] = 0.1
    now[59, 60:66, :3] = 0.46
    wanted = cored(picture_of(now), drawn, AS_IT_IS)
    np.testing.assert_allclose(wanted[60:66, 60:66, :3], 0.1, atol=1.0 / 255.0)
    np.testing.assert_allclose(wanted[59, 60:66, :3], 0.46, atol=1.0 / 255.0)


def test_an_exposure_is_no_news_and_found_where_both_show_the_person():
    drawn = person(checks(8))
    dimmed = drawn * np.array([0.8, 0.9, 1.0, 1.0], np.float32)
    dimmed[:20, :20] = 1.0
    exposure = exposure_beside(picture_of(dimmed), drawn)
    assert exposure is not None
    np.testing.assert_allclose(exposure, [0.8, 0.9, 1.0], atol=0.005)
    wanted = cored(picture_of(dimmed), drawn, exposure)
    np.testing.assert_allclose(
        wanted[PERSON, PERSON, :3], drawn[PERSON, PERSON, :3] * exposure, atol=1e-6
    )


@pytest.mark.parametrize(("level", "limit"), [(0.1, 0.7), (1.0, 1.4)])
def test_no_exposure_is_beyond_what_a_webcam_does(level: float, limit: float):
    exposure = exposure_beside(picture_of(person((level, level, level))), person((0.5, 0.5, 0.5)))
    assert exposure is not None
    np.testing.assert_allclose(exposure, limit)


def test_where_nobody_is_there_is_no_exposure():
    assert exposure_beside(picture_of(np.zeros((SIDE, SIDE, 4))), person((0.5, 0.5, 0.5))) is None
