"""What stands out where frames show nobody is drawn back."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import COLOUR, OPACITY, POSITION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.training.views import View
from renderer.splats.training.visual_hull import share_within_outlines
from scene.arrays import Bool, Float
from scene.camera import orbit_camera
from scene.motion import Motion, Pose
from scene.skeleton import HEAD, JOINT_COUNT
from tests.renderer.splats.training.heads import bald_head

POSES = np.tile(np.eye(4, dtype=np.float32), (JOINT_COUNT, 1, 1))
LENGTH_M, WIDTH_M = 0.04, 0.005


def view(azimuth: float) -> View:
    """A bald head, from there."""
    body, first, _ = bald_head()
    parameters = first.parameters.copy()
    parameters[:, COLOUR : COLOUR + 3], parameters[:, OPACITY] = 0.6, 4.0
    motion = Motion.from_poses([Pose(np.zeros((JOINT_COUNT, 3)), np.zeros(3), 0.0)])
    joints, seen = first.joints.astype(np.uint8), np.ones(len(parameters), bool)
    drawn = SplatModel(parameters, joints, first.weights, seen, body.skeleton, motion, "a test")
    camera = orbit_camera(body.skeleton.rest_joints[HEAD], 1.2, azimuth, 0.0, 240, 240, 0.5)
    rgba = SplatRenderer((drawn,)).render(camera, [POSES])
    return View.of((255.0 * rgba + 0.5).astype(np.uint8), camera)


def on_head(*, normal: tuple[float, float, float]) -> Bool[np.ndarray, "N"]:
    body, first, _ = bald_head()
    above = first.parameters[:, POSITION + 1] - body.skeleton.rest_joints[HEAD][1]
    return (first.normals @ np.array(normal) > 0.9) & (above > 0.03)


def shares(where: Bool[np.ndarray, "N"], *views: View) -> Float[np.ndarray, "M"]:
    """Of moves along the normals of the splats that are `where`."""
    _, first, _ = bald_head()
    return share_within_outlines(
        first.parameters[where],
        first.joints[where],
        first.weights[where],
        LENGTH_M * first.normals[where],
        np.full(where.sum(), WIDTH_M),
        [(one, POSES) for one in views],
    )


def test_beside_an_outline_nothing_stands_out():
    beside = on_head(normal=(1.0, 0.0, 0.0))
    assert np.median(shares(beside, view(0.0))) < 0.1


def test_behind_a_head_one_frame_from_the_front_allows_all_and_one_from_beside_does_not():
    behind = on_head(normal=(0.0, 0.0, -1.0))
    assert shares(behind, view(0.0)) == pytest.approx(1.0)
    assert np.median(shares(behind, view(0.0), view(0.5 * np.pi))) < 0.1


@pytest.mark.parametrize(("wrong", "share"), [(1, 1.0), (3, 0.0)])
def test_one_frame_in_ten_that_shows_nobody_is_a_mistake_and_three_are_none(wrong, share):
    behind, right = on_head(normal=(0.0, 0.0, -1.0)), view(0.0)
    nobody = View.of(np.zeros_like(right.rgba), right.window)
    found = shares(behind, *[right] * (10 - wrong), *[nobody] * wrong)
    assert found == pytest.approx(share)


def test_a_picture_that_does_not_hold_it_says_nothing():
    beside, whole = on_head(normal=(1.0, 0.0, 0.0)), view(0.0)
    below = View.of(whole.rgba[200:], whole.window.cropped(0, 200, 240, 40))
    assert shares(beside, below) == pytest.approx(1.0)


def test_a_single_splat_has_no_others_beside_it():
    behind = np.flatnonzero(on_head(normal=(0.0, 0.0, -1.0)))[:1]
    one = np.zeros(len(bald_head()[1].parameters), bool)
    one[behind] = True
    assert shares(one, view(0.0)).tolist() == [1.0]
