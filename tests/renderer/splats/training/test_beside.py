"""A frame's pixels, carried over to a camera beside it by the surface that both see."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import (
    LOG_SCALE,
    OPACITY,
    PARAMETERS,
    ROTATION,
    UNKNOWN,
)
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.training.beside import PosedSurface, seen_from_beside
from renderer.splats.training.views import View
from scene.arrays import Array, Float
from scene.camera import Camera, orbit_camera

STILL = np.tile(np.eye(4, dtype=np.float32), (24, 1, 1))
SIZE, HALF_M = 96, 0.5


def wall(z: float = 0.0, half_m: float = HALF_M, step_m: float = 0.01) -> np.ndarray:
    """Flat, opaque splats on a square that faces +z."""
    across = np.arange(-half_m, half_m + 1e-6, step_m)
    x, y = np.meshgrid(across, across)
    parameters = np.zeros((x.size, PARAMETERS), np.float32)
    parameters[:, 0], parameters[:, 1], parameters[:, 2] = x.ravel(), y.ravel(), z
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log([step_m, step_m, 0.1 * step_m])
    parameters[:, ROTATION], parameters[:, OPACITY] = 1.0, 6.0
    return parameters


def surface_of(parameters: np.ndarray) -> PosedSurface:
    count = len(parameters)
    normals = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (count, 1))
    weights = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (count, 1))
    return PosedSurface(parameters, normals, np.zeros((count, 4), np.uint16), weights, STILL)


def front() -> Camera:
    return orbit_camera((0.0, 0.0, 0.0), 2.0, 0.0, 0.0, SIZE, SIZE)


def painted(points: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """Smooth colours of the plane z = 0, 0 to 255."""
    x, y = points[..., 0], points[..., 1]
    return 127.0 + 100.0 * np.stack([np.sin(4 * x), np.cos(3 * y), np.sin(2 * x + 3 * y)], axis=-1)


def met(camera: Camera) -> Float[Array, "H W 3"]:
    """Where the camera's rays meet the plane z = 0."""
    origins, directions = camera.rays()
    return origins - directions * (origins[..., 2:] / directions[..., 2:])


def filmed(camera: Camera) -> View:
    rgba = np.full((camera.height, camera.width, 4), 255, np.uint8)
    rgba[..., :3] = painted(met(camera)) + 0.5
    return View.of(rgba, camera)


def carried(
    angle_deg: float, parameters: np.ndarray | None = None, *, told: bool = True
) -> tuple[Camera, np.ndarray]:
    parameters = wall() if parameters is None else parameters
    frame, surface = filmed(front()), surface_of(parameters)
    camera = frame.window.carried_round(np.zeros(3), np.radians(angle_deg))
    some = np.full(len(parameters), told)
    view = seen_from_beside(frame, frame.rgba, camera, surface, some, Workspace(len(parameters)))
    assert view.window is camera
    return camera, view.rgba


def is_unknown(rgba: np.ndarray) -> np.ndarray:
    return (rgba == np.array(UNKNOWN)).all(axis=-1)


@pytest.mark.parametrize("angle_deg", [-50.0, -20.0, 0.0, 35.0, 55.0])
def test_colours_are_those_of_the_surface_from_there(angle_deg: float):
    camera, rgba = carried(angle_deg)
    known = rgba[..., 3] == 255
    assert known.sum() > 500
    error = np.abs(rgba[..., :3].astype(float) - painted(met(camera)))[known]
    assert error.max() < 4.0
    assert error.mean() < 1.0


def test_beyond_the_outline_there_is_nothing_and_at_it_nothing_is_said():
    _, rgba = carried(30.0)
    known = rgba[..., 3] == 255
    rows = np.flatnonzero(known.any(axis=1))
    middle = rgba[(rows[0] + rows[-1]) // 2]
    left = np.flatnonzero(middle[:, 3] == 255)[0]
    assert is_unknown(middle[left - 3 : left]).all()
    assert not middle[: left - 6].any()


def test_what_is_turned_away_from_the_frame_is_not_told():
    """Seen from beside, the wall is as the frame sees it at 75 degrees."""
    frame, surface = (
        filmed(front().carried_round(np.zeros(3), np.radians(75.0))),
        surface_of(wall()),
    )
    everything = np.ones(len(wall()), bool)
    view = seen_from_beside(frame, frame.rgba, front(), surface, everything, Workspace(len(wall())))
    assert not (view.rgba[..., 3] > 0).any()
    assert is_unknown(view.rgba[SIZE // 2, SIZE // 2])


def test_what_is_hidden_in_the_frame_is_not_told():
    """A small square hides a part of the wall behind; from beside it is seen, and unknown."""
    hiding = wall(0.3, 0.15)
    _, rgba = carried(40.0, np.concatenate([wall(), hiding]))
    _, open_wall = carried(40.0)
    hidden = is_unknown(rgba) & (open_wall[..., 3] == 255)
    assert 100 < hidden.sum() < 0.5 * (open_wall[..., 3] == 255).sum()


def test_parts_that_are_not_to_be_told_are_not():
    _, rgba = carried(20.0, told=False)
    assert is_unknown(rgba[SIZE // 2, SIZE // 2])
    assert not (rgba[..., 3] > 0).any()


def test_pixels_that_show_background_too_tell_nothing():
    frame, surface = filmed(front()), surface_of(wall())
    frame.rgba[:, SIZE // 2 :, 3] = 200
    everything = np.ones(len(wall()), bool)
    view = seen_from_beside(frame, frame.rgba, front(), surface, everything, Workspace(len(wall())))
    assert (view.rgba[SIZE // 2, : SIZE // 2 - 30, 3] == 255).any()
    assert not (view.rgba[:, SIZE // 2 :, 3] > 0).any()
