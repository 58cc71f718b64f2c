"""What stands behind the person: learnt by a still camera, trusted nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from capture.segmentation.background import BackgroundModel, learn_background

SIZE = 96
FRAMES = 12


def room(rng: np.random.Generator) -> np.ndarray:
    """A wall with patches of clearly different colours."""
    patches = rng.integers(40, 200, (8, 8, 3)).astype(np.uint8)
    return cv2.resize(patches, (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)


def walking(
    shift_px: int = 0, noise: float = 2.0
) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    """Frames of a red block that walks through a room, where it is, and the room."""
    rng = np.random.default_rng(3)
    empty = room(rng)
    images, covered = [], []
    for index in range(FRAMES):
        image = np.roll(empty, index * shift_px, axis=1).astype(np.float64)
        where = np.zeros((SIZE, SIZE), np.uint8)
        where[20:70, 4 * index : 4 * index + 24] = 1
        image[where > 0] = (250, 10, 10)
        image += rng.normal(0.0, noise, image.shape)
        images.append(np.clip(image + 0.5, 0, 255).astype(np.uint8))
        covered.append(where)
    return images, covered, empty


@pytest.fixture(scope="module")
def learnt() -> tuple[BackgroundModel, list[np.ndarray], list[np.ndarray], np.ndarray]:
    images, covered, empty = walking()
    background = learn_background(images, covered)
    assert background is not None
    return background, images, covered, empty


def test_a_still_room_is_learnt_where_it_was_seen(learnt):
    background, _, covered, empty = learnt
    often = FRAMES - np.sum(covered, axis=0) >= 4
    assert background.known[often].mean() > 0.98
    assert not background.known[~often].any()
    np.testing.assert_allclose(
        background.colour[background.known], empty[background.known], atol=4.0
    )
    assert background.noise == pytest.approx(2.0, rel=0.15)


def test_somebody_differs_and_nobody_does_not(learnt):
    background, images, covered, _ = learnt
    everywhere = slice(0, SIZE)
    somebody, nobody = background.classify(images[5], everywhere, everywhere)
    inside = cv2.erode(covered[5], np.ones((3, 3))) > 0
    away = (cv2.dilate(covered[5], np.ones((5, 5))) == 0) & background.known
    assert somebody[inside & background.known].all()
    assert not somebody[away].any()
    assert not nobody[inside].any()
    assert nobody[away].mean() > 0.9


def test_a_shadow_is_not_somebody(learnt):
    background, _, _, empty = learnt
    everywhere = slice(0, SIZE)
    dark = np.round(0.75 * empty).astype(np.uint8)
    somebody, nobody = background.classify(dark, everywhere, everywhere)
    assert not somebody.any()
    assert not nobody.any()  # but it is not sure of that either


def test_a_moving_camera_teaches_nothing():
    images, covered, _ = walking(shift_px=5)
    assert learn_background(images, covered) is None


def test_too_few_frames_teach_nothing():
    images, covered, _ = walking()
    assert learn_background(images[:3], covered[:3]) is None
    assert learn_background(images, [np.ones((SIZE, SIZE), np.uint8)] * FRAMES) is None


def test_what_flickers_is_not_known():
    images, covered, _ = walking()
    for index, image in enumerate(images):
        image[80:90, 80:90] = 255 * (index % 2)
    background = learn_background(images, covered)
    assert background is not None
    assert not background.known[80:90, 80:90].any()
