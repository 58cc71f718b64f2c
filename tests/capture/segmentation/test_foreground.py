"""The person's own colour at half-covered pixels: exact blends give back what was blended."""

from __future__ import annotations

import cv2
import numpy as np

from capture.segmentation.foreground import premultiplied

SIZE = 64


def soft_disc() -> np.ndarray:
    """Alpha of a disc with an edge five pixels wide."""
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    radius = np.hypot(x - SIZE / 2, y - SIZE / 2)
    return np.clip((20.0 - radius) / 5.0 + 0.5, 0.0, 1.0).astype(np.float32)


def seen(person: np.ndarray, behind: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """The picture of `person` (sRGB) in front of `behind`."""
    blend = alpha[..., None] * person + (1.0 - alpha[..., None]) * behind
    return np.round(255.0 * blend).astype(np.uint8)


def test_one_colour_in_front_of_another_comes_back():
    alpha = soft_disc()
    person, behind = np.array([0.8, 0.3, 0.1]), np.array([0.1, 0.2, 0.9])
    image = seen(person, behind, alpha)
    truth = alpha[..., None] * person
    own = premultiplied(image, alpha)
    naive = image / 255.0 * alpha[..., None]
    edge = (alpha > 0.02) & (alpha < 0.98)
    assert own.dtype == np.float32
    assert np.abs(own - truth)[edge].mean() < 0.25 * np.abs(naive - truth)[edge].mean()
    assert np.abs(own - truth).max() < 0.08


def test_patterns_in_front_of_a_busy_room_gain_too():
    rng = np.random.default_rng(1)
    alpha = soft_disc()
    person, behind = (
        cv2.resize(rng.random((8, 8, 3)), (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)
        for _ in range(2)
    )
    image = seen(0.5 * person + 0.5, 0.5 * behind, alpha)
    truth = alpha[..., None] * (0.5 * person + 0.5)
    edge = (alpha > 0.02) & (alpha < 0.98)
    naive = np.abs(image / 255.0 * alpha[..., None] - truth)[edge].mean()
    assert np.abs(premultiplied(image, alpha) - truth)[edge].mean() < 0.6 * naive


def test_inside_is_the_picture_and_outside_is_black():
    alpha = soft_disc()
    image = np.random.default_rng(2).integers(0, 255, (SIZE, SIZE, 3)).astype(np.uint8)
    own = premultiplied(image, alpha)
    np.testing.assert_allclose(own[alpha == 1.0], image[alpha == 1.0] / 255.0, atol=1e-6)
    assert not own[alpha == 0.0].any()
    assert (own <= alpha[..., None] + 1e-6).all()  # no colour is brighter than white


def test_nobody_has_no_colour():
    image = np.full((8, 8, 3), 200, np.uint8)
    assert not premultiplied(image, np.zeros((8, 8), np.float32)).any()
