"""Frames registered to the model: smooth shifts are found and taken out, and nothing else is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from renderer.splats.training.registration import flow_to_frame, registered
from renderer.splats.training.views import View
from scene.arrays import Array
from scene.camera import orbit_camera

HEIGHT, WIDTH = 160, 120


def person(right: float = 0.0, down: float = 0.0) -> Array:
    """Cloth with a print all over, in an ellipse, moved by so many px: premultiplied sRGB."""
    coarse = np.random.default_rng(1).uniform(size=(HEIGHT // 8, WIDTH // 8, 3))
    colours = cv2.resize(coarse.astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    outline = 1.0 - np.hypot((x - WIDTH / 2) / 40.0, (y - HEIGHT / 2) / 65.0)
    alpha = np.clip(outline * 20.0 + 0.5, 0.0, 1.0)[..., None]
    picture = np.concatenate([np.clip(colours, 0.0, 1.0) * alpha, alpha], axis=2)
    shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
    return cv2.warpAffine(picture.astype(np.float32), shift, (WIDTH, HEIGHT))


def view_of(picture: Array) -> View:
    camera = orbit_camera((0.0, 0.8, 0.0), 3.4, 0.0, 0.0, WIDTH, HEIGHT)
    return View.of((picture * 255.0 + 0.5).astype(np.uint8), camera)


def test_a_shift_of_two_pixels_is_found_and_taken_out():
    made, truth = person(), person(2.0, -1.0)
    flow = flow_to_frame(made, truth)
    middle = flow[24:40, 24:40].astype(np.float32) * HEIGHT
    np.testing.assert_allclose(middle.mean(axis=(0, 1)), [2.0, -1.0], atol=0.35)
    before = np.abs(view_of(truth).rgba.astype(int) - view_of(made).rgba)
    after = np.abs(registered(view_of(truth), flow).rgba.astype(int) - view_of(made).rgba)
    assert after.mean() < 0.35 * before.mean()


def test_what_already_fits_stays_to_the_bit():
    view, flow = view_of(person()), flow_to_frame(person(), person())
    assert not flow.any()
    np.testing.assert_array_equal(registered(view, flow).rgba, view.rgba)


def test_less_than_noise_is_left_alone():
    assert not flow_to_frame(person(), person(0.04)).any()


def test_far_from_the_model_nothing_is_moved_and_nothing_far():
    flow = flow_to_frame(person(), person(12.0)).astype(np.float32)
    assert np.linalg.norm(flow, axis=2).max() <= 0.0201
    flow = flow_to_frame(person(), person(2.0)).astype(np.float32)
    assert np.abs(flow[:2, :2]).max() < 1e-3


def test_colours_stay_premultiplied():
    flow = flow_to_frame(person(), person(2.0, 2.0))
    moved = registered(view_of(person(2.0, 2.0)), flow).rgba
    assert (moved[..., :3] <= moved[..., 3:]).all()


@pytest.mark.parametrize("size", [(4, 3), (12, 9), (5, 80), (13, 48)])
def test_pictures_may_be_tiny(size: tuple[int, int]):
    picture = np.random.default_rng(0).uniform(size=(*size, 4)).astype(np.float32)
    assert np.isfinite(flow_to_frame(picture, picture)).all()
