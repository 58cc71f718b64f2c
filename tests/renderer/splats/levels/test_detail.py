"""Detail follows the size on screen a little at a time, and pictures hardly change by it."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from renderer.performer_model import PerformerModel
from renderer.scene_renderer import SceneRenderer
from renderer.splats.levels.detail import FULL_DENSITY, MOST_CHANGE, ViewDetail
from renderer.splats.levels.tree import FEWEST, level_tree, tree_soon
from renderer.splats.model import SplatModel
from scene import Environment, Performer, Scene, orbit_camera
from scene.arrays import Array
from scene.camera import Camera
from scene.live_appearance import LiveAppearance
from tests.renderer.splats.viewer_file import demo_model
from tests.renderer.studio import make_model


@pytest.fixture(scope="module")
def demo() -> SplatModel:
    model = demo_model()
    level_tree(model)
    return model


def drawn(detail: ViewDetail, model: SplatModel, *heights_px: float) -> list[int]:
    detail.drawn([(model, level_tree(model))] * len(heights_px), list(heights_px))
    return detail.counts


def camera(distance_m: float, size: int = 256) -> Camera:
    return orbit_camera((0, 0.9, 0), distance_m, 0.3, 0.05, size, size)


def scene(model: SplatModel, frame: int, change: Array | None = None) -> Scene[PerformerModel]:
    pose = model.motion.pose(frame)
    looks = None if change is None else LiveAppearance(change)
    still = replace(pose, root_translation=pose.root_translation * [0.0, 1.0, 0.0])
    performer = Performer[PerformerModel]("demo", model, np.zeros(3), 0.0, still, looks)
    return Scene(Environment(), (performer,))


def test_who_is_small_has_few_splats_and_who_comes_near_gets_them_bit_by_bit(demo):
    detail = ViewDetail()
    assert drawn(detail, demo, 120.0) == [round(FULL_DENSITY * 120**2)]
    counts = [drawn(detail, demo, 300.0)[0] for _ in range(80)]
    assert counts[-1] == len(demo)
    assert detail.settled
    shares = np.diff([3600, *counts]) / [3600, *counts[:-1]]
    assert (shares >= 0.0).all()
    assert shares.max() <= MOST_CHANGE
    assert drawn(ViewDetail(), demo, 10.0) == [FEWEST]


def test_steps_nearer_and_back_change_nothing(demo):
    detail = ViewDetail()
    first = drawn(detail, demo, 150.0)
    for height in (152.0, 147.0, 150.0):
        assert drawn(detail, demo, height) == first


def test_a_budget_is_shared_by_size(demo):
    detail = ViewDetail()
    detail.density = 0.05
    near, far = drawn(detail, demo, 400.0, 200.0)
    assert (near, far) == (8000, 2000)
    assert detail.density_drawn == pytest.approx(0.05)
    detail.density = FULL_DENSITY
    for _ in range(80):
        counts = drawn(detail, demo, 400.0, 200.0)
    assert counts == [len(demo), len(demo)]
    assert detail.density_drawn == pytest.approx(0.25)


def test_nobody_sees_the_detail_change(demo):
    """What a step of it changes is well below what a thirtieth of a second of motion does."""
    stage, before = SceneRenderer(detail := ViewDetail()), np.zeros(0)
    changes = []
    for picture in range(30):
        detail.density = FULL_DENSITY if picture < 2 else 0.03
        now = stage.render(scene(demo, 40), camera(3.0)).astype(float).copy()
        changes.append(np.abs(now - before).mean() if picture else 0.0)
        before = now
    assert detail.counts[0] < 0.5 * len(demo)
    moved = stage.render(scene(demo, 41), camera(3.0)).astype(float)
    assert max(changes[2:]) < 0.1 * np.abs(moved - before).mean()


def test_a_live_look_colours_every_level(demo):
    black = -np.ones((len(demo), 3), np.float32)
    detail = ViewDetail()
    detail.density = 0.01
    stage = SceneRenderer(detail)
    plain = stage.render(scene(demo, 0), camera(3.0)).astype(int).copy()
    dark = stage.render(scene(demo, 0, black), camera(3.0)).astype(int)
    assert detail.counts == [FEWEST]
    body = np.abs(plain - dark).sum(axis=2) > 30
    assert body.sum() > 1000
    assert dark[body].mean() < 60.0


def test_levels_come_while_the_model_is_drawn_whole():
    model = demo_model()
    stage = SceneRenderer(detail := ViewDetail())
    stage.render(scene(model, 0), camera(8.0))
    assert detail.counts == [len(model)]
    ends_s = time.monotonic() + 60.0
    while tree_soon(model) is None and time.monotonic() < ends_s:
        time.sleep(0.05)
    stage.render(scene(model, 0), camera(8.0))
    assert detail.counts == [len(model) - int(MOST_CHANGE * len(model))]
    assert tree_soon(make_model(80)) is None  # one level alone


def test_all_splats_of_a_tree_are_the_same_picture(demo):
    with_levels = SceneRenderer(detail := ViewDetail())
    seen = with_levels.render(scene(demo, 10), camera(2.5)).astype(int)
    assert detail.counts == [len(demo)]
    plain = SceneRenderer().render(scene(demo, 10), camera(2.5)).astype(int)
    assert np.abs(seen - plain).max() <= 40  # what is equally far may change places
    assert np.abs(seen - plain).mean() < 0.02
