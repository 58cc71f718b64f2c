"""Which splat a pixel shows, by rows of tiles, one pixel at a time, and against a plain sum."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import (
    ALPHA,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    FAINTEST,
    MEAN_X,
    MEAN_Y,
    MOST_OPAQUE,
)
from renderer.splats.rasteriser.workspace import Workspace
from tests.renderer.splats.rasteriser.test_rasteriser import DILATION, make_camera, make_scene


def shown(work: Workspace, order: np.ndarray, x: int, y: int) -> tuple[int, float]:
    """The splat that pixel (x, y) shows, and how close the second choice comes to it."""
    splats = work.projected[order].astype(np.float64)
    dx, dy = x + 0.5 - splats[:, MEAN_X], y + 0.5 - splats[:, MEAN_Y]
    power = -0.5 * (splats[:, CONIC_A] * dx**2 + splats[:, CONIC_C] * dy**2)
    alpha = np.minimum(splats[:, ALPHA] * np.exp(power - splats[:, CONIC_B] * dx * dy), MOST_OPAQUE)
    alpha[alpha < FAINTEST] = 0.0
    through = np.concatenate([[1.0], np.cumprod(1.0 - alpha)])
    weights = np.append(alpha * through[:-1], through[-1])
    best = int(np.argmax(weights))
    second = np.delete(weights, best).max()
    return (int(order[best]) if best < len(order) else -1), float(weights[best] - second)


@pytest.mark.parametrize(("count", "width", "height"), [(20, 32, 32), (60, 50, 37), (400, 64, 48)])
def test_each_pixel_shows_the_splat_that_gives_it_most(count: int, width: int, height: int):
    work = Workspace(count)
    front = work.front(*make_scene(count, seed=3), make_camera(width, height), DILATION)
    assert front.shape == (height, width)
    assert (front >= 0).any()
    assert (front < 0).any() or count == 400
    listed = np.unique(work.entries[: work.starts[-1]])
    order = listed[np.argsort(work.depth[listed])]
    for y in range(0, height, 3):
        for x in range(0, width, 3):
            best, ahead = shown(work, order, x, y)
            assert front[y, x] == best or ahead < 1e-3
    rows, columns = np.indices((height, width)).reshape(2, -1)
    alone = work.front_of_pixels(rows, columns, width)
    assert (alone == front.ravel()).mean() > 0.999
