"""What steps see of frames that were filmed large: all of them small, parts at full size."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.settings import SplatSettings
from renderer.splats.training.full_size import FullSizeWindows, whole_views
from renderer.splats.training.initialisation import first_splats
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View
from scene.camera import orbit_camera
from tests.renderer.studio import make_sequence


def views(*sizes: tuple[int, int]) -> list[View]:
    """Blank pictures of so many (width, height) px."""
    return [
        View.of(
            np.zeros((height, width, 4), np.uint8),
            orbit_camera((0.0, 0.8, 0.0), 3.4, 0.0, 0.0, width, height),
        )
        for width, height in sizes
    ]


def test_pictures_that_are_small_enough_stay_what_they_are():
    filmed = views((40, 64), (50, 60))
    assert all(a is b for a, b in zip(whole_views(filmed, 64), filmed, strict=True))


def test_larger_ones_are_shrunk_by_one_share():
    shapes = [view.rgba.shape[:2] for view in whole_views(views((40, 128), (50, 60)), 64)]
    assert shapes == [(64, 20), (30, 25)]


def test_a_window_lies_about_a_splat_where_it_is_posed():
    sequence, settings = make_sequence(), SplatSettings(count=400, window_px=32)
    first = first_splats(sequence, settings, np.random.default_rng(0))
    (view,) = views((320, 320))
    windows = FullSizeWindows([view], settings)
    splats = TrainedSplats(first, sequence.body.skeleton, sequence.motion.expressions, settings)
    raised = np.tile(np.eye(4, dtype=np.float32), (24, 1, 1))
    raised[:, 1, 3] = 0.1
    chance = np.random.default_rng(0)
    centres = []
    for _ in range(200):
        part = windows.drawn(0, splats, raised, chance)
        assert part.rgba.shape == (32, 32, 4)
        shift = view.window.intrinsics[:2, 2] - part.window.intrinsics[:2, 2]
        centres.append(shift + 16.0)
    pixels, _ = view.window.project(first.parameters[:, :3] + np.array([0.0, 0.1, 0.0]))
    np.testing.assert_allclose(np.mean(centres, axis=0), pixels.mean(axis=0), atol=12.0)
    assert np.std(centres, axis=0)[1] == pytest.approx(pixels[:, 1].std(), rel=0.2)
