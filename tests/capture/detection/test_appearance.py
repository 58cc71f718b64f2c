"""Who wears what: one person stays alike through light and turns, another is none."""

from __future__ import annotations

import numpy as np
import pytest

from capture.body.landmark_names import LANDMARK_NAMES
from capture.detection.appearance import SAME_PERSON, Appearance
from capture.detection.landmarks import Landmarks

_COUNT = len(LANDMARK_NAMES)


def _person(mask: np.ndarray) -> Landmarks:
    nil = np.zeros((_COUNT, 3))
    return Landmarks(nil[:, :2], nil, np.ones(_COUNT), mask.astype(np.float32))


def _dressed(
    shirt: tuple[int, ...], trousers: tuple[int, ...], seed: int = 0
) -> tuple[np.ndarray, Landmarks]:
    """A picture, and who is in its middle."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (60, 60, 3)).astype(np.uint8)
    mask = np.zeros((60, 60), bool)
    mask[5:55, 20:40] = True
    image[5:30, 20:40], image[30:55, 20:40] = shirt, trousers
    noise = rng.normal(0.0, 5.0, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8), _person(mask)


RED, BLUE, GREY, GREEN = (180, 40, 50), (40, 60, 150), (110, 110, 112), (60, 140, 70)


@pytest.fixture
def known() -> Appearance:
    appearance = Appearance()
    appearance.update(*_dressed(RED, BLUE))
    return appearance


def test_the_same_clothes_are_alike_wherever_they_are(known):
    image, person = _dressed(RED, BLUE, seed=1)
    assert known.similarity(image, person) > 0.99
    assert known.similarity(np.clip(image * 0.93, 0, 255).astype(np.uint8), person) > SAME_PERSON


@pytest.mark.parametrize("clothes", [(GREEN, GREY), (RED, GREY), (GREEN, BLUE)])
def test_other_clothes_are_not(known, clothes):
    assert known.similarity(*_dressed(*clothes)) < SAME_PERSON


def test_what_changes_slowly_stays_known_and_the_first_look_is_never_forgotten(known):
    for share in np.linspace(0.0, 1.0, 40):
        shade = tuple(round(c * (1.0 - 0.6 * share)) for c in RED)
        known.update(*_dressed(shade, BLUE))
    darkest = tuple(round(0.4 * c) for c in RED)
    assert known.similarity(*_dressed(darkest, BLUE)) > SAME_PERSON
    assert known.similarity(*_dressed(RED, BLUE)) > 0.99


def test_half_of_somebody_else_is_not_remembered(known):
    image, person = _dressed(RED, BLUE)
    image[12:42, 20:40] = GREEN
    before = known.similarity(*_dressed(GREEN, BLUE))
    known.update(image, person)
    assert known.similarity(*_dressed(GREEN, BLUE)) == before


def test_who_has_no_mask_may_be_anybody(known):
    image, _ = _dressed(GREEN, GREY)
    assert known.similarity(image, _person(np.zeros((60, 60)))) == 1.0
    assert Appearance().similarity(*_dressed(GREEN, GREY)) == 1.0
