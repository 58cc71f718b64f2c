"""A picture laid on splats: where it is laid, how strongly, and that it comes to its own pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.splats.layout import BOX_FILTER_PX2, MEAN_X, MEAN_Y
from renderer.splats.rasteriser.laying import Laying
from renderer.splats.rasteriser.laying_kernels import WHOLE
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from scene.camera import Camera, orbit_camera
from scene.live_appearance import LaidPicture, LiveAppearance
from scene.skeleton import CHEST
from tests.renderer.splats.rasteriser.test_gpu import both_renderers, made_model
from tests.renderer.splats.rasteriser.test_rasteriser import make_camera

CHEST_M = np.array([0.1, 1.3, 0.0])


def looking_at_the_chest(azimuth_deg: float, distance_m: float) -> Camera:
    return orbit_camera(CHEST_M, distance_m, np.radians(azimuth_deg), 0.0, 100, 100)


def taken_by(webcam: Camera, carried: np.ndarray, places=None, detail=None) -> LaidPicture:
    """A picture of somebody whose chest `carried` has from rest to the webcam's world."""
    at_rest = carried[:3, :3].T @ (webcam.position - carried[:3, 3])
    focal_px = float(webcam.intrinsics[0, 0])
    nothing = np.ones((2, 2, 3), np.float32) if detail is None else detail
    return LaidPicture(nothing, np.zeros((0, 3)) if places is None else places, at_rest, focal_px)


@pytest.mark.parametrize(
    ("beside_deg", "strength"), [(0, 1.0), (7.9, 1.0), (12, 0.5), (16.1, 0.0), (90, 0.0), (180, 0)]
)
def test_it_fades_beside_the_webcam(beside_deg: float, strength: float):
    laid = taken_by(looking_at_the_chest(30.0, 0.8), np.eye(4))
    view = looking_at_the_chest(30.0 + beside_deg, 2.4)
    laying = Laying.seen_by(laid, view, np.eye(4), CHEST_M)
    assert laying.strength == pytest.approx(strength, abs=1e-3)


def test_the_webcam_goes_with_the_chest_and_distance_is_scale():
    webcam = looking_at_the_chest(30.0, 0.8)
    carried = np.eye(4)
    carried[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    carried[:3, 3] = 2.0, 0.0, -1.0
    laid = taken_by(webcam, np.eye(4))
    # from the place that the webcam would have before them now, three times as far away
    chest = carried[:3, :3] @ CHEST_M + carried[:3, 3]
    towards = carried[:3, :3] @ (webcam.position - CHEST_M)
    view = orbit_camera(chest, 2.4, float(np.arctan2(towards[0], towards[2])), 0.0, 100, 100)
    laying = Laying.seen_by(laid, view, carried, CHEST_M)
    assert laying.strength == pytest.approx(1.0)
    assert laying.scale == pytest.approx(3.0, rel=1e-6)
    twice = replace(view, intrinsics=view.intrinsics * [[2.0], [2.0], [1.0]])
    assert Laying.seen_by(laid, twice, carried, CHEST_M).scale == pytest.approx(1.5, rel=1e-6)


def test_seen_by_the_webcam_itself_every_pixel_is_laid_where_it_came_from():
    """By the GPU's kernels too, and behind somebody who has no picture."""
    model, transforms = made_model(200)
    front, _ = made_model(12, seed=3)
    nearer = transforms.copy()
    nearer[:, 2, 3] += 0.9
    camera, moved = make_camera(72, 56), [nearer, transforms]
    detail = np.random.default_rng(1).uniform(0.5, 1.0, (56, 72, 3)).astype(np.float32)
    work, joints = Workspace(200), model.joints.astype(np.uint16)
    work.arrange(
        model.parameters,
        joints,
        model.weights,
        transforms,
        pack_camera(camera),
        *(72, 56),
        BOX_FILTER_PX2,
    )
    means = work.projected[:, MEAN_X : MEAN_Y + 1]
    seen = np.ones((200, 1), np.float32)
    laid = taken_by(camera, transforms[CHEST], np.concatenate([means, seen], axis=1), detail)
    looks = [None, LiveAppearance(np.zeros((200, 3), np.float32), laid)]
    in_front = SplatRenderer((front,)).render(camera, [nearer])[..., 3:]
    for renderer, atol in zip(both_renderers((front, model)), (2.5e-3, 5e-3), strict=True):
        # where less than a 256th of a pixel is theirs nothing is laid
        plain = renderer.render(camera, moved).copy()
        share = 1.0 - in_front / np.maximum(plain[..., 3:], 1e-6)
        whole = np.minimum(share / WHOLE, 1.0)
        expected = plain[..., :3] * (1.0 + whole * (detail - 1.0))
        shown = renderer.render(camera, moved, appearances=looks)
        np.testing.assert_allclose(shown[..., :3], expected, atol=atol)
        np.testing.assert_array_equal(shown[..., 3], plain[..., 3])
        assert np.abs(expected - plain[..., :3]).max() > 0.2
        assert share[plain[..., 3] > 0.1].min() < 0.2, "somebody stands in front"
