"""Scenes: the room's kernel against its twin, people before and behind each other, shadows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from renderer.performer_model import PerformerModel
from renderer.reference import backdrop as twin
from renderer.scene_renderer import SceneRenderer, contact_shadows, shadow_blocks
from scene import Environment, InvalidInput, Performer, Pose, Scene, orbit_camera
from scene.skeleton import HEAD
from tests.renderer.splats.cloth.wear import make_loose_model
from tests.renderer.studio import make_model

ROOM = Environment()
COLOURS = np.array([ROOM.horizon, ROOM.zenith, ROOM.floor], np.float32)


def stand(x: float, z: float, name: str = "one", yaw: float = 0.0) -> Performer:
    return Performer(name, make_model(), np.array([x, 0.0, z]), yaw, Pose.rest())


def test_the_room_matches_its_twin():
    from renderer.compositing.backdrop_kernels import compose

    camera = orbit_camera((0, 0.8, 0), 3.0, 0.5, 0.2, 80, 56)
    rng = np.random.default_rng(0)
    rgba = rng.uniform(0, 0.7, (56, 80, 4)).astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:]
    shadows = np.array([[0.1, -0.2, 0.3, 0.5], [0.5, 0.4, 0.2, 0.3]], np.float32)
    out = np.zeros((56, 80, 3), np.uint8)
    drawn = np.ones((4, 5), bool)
    drawn[1, 2] = False
    out[16:32, 32:48] = 7
    compose(out, rgba, camera.intrinsics, camera.rotation, camera.position, COLOURS, shadows, drawn)
    assert (out[16:32, 32:48] == 7).all()
    drawn[:] = True
    compose(out, rgba, camera.intrinsics, camera.rotation, camera.position, COLOURS, shadows, drawn)
    slow = twin.compose(rgba, camera, COLOURS.astype(np.float64), shadows)
    difference = np.abs(out.astype(int) - slow.astype(int))
    assert np.percentile(difference, 99) <= 1
    assert difference.max() <= 6  # a grid line's edge may fall on either side


def test_sky_is_above_floor():
    picture = SceneRenderer().render(
        Scene(ROOM, ()), orbit_camera((0, 0.8, 0), 3.0, 0.0, 0.05, 64, 64)
    )
    assert picture.shape == (64, 64, 3)
    assert picture[2].mean(axis=0)[2] > picture[2].mean(axis=0)[0]  # the zenith is blue
    assert picture[-2].mean() < picture[30].mean()  # the floor is darker than the horizon


def test_whoever_looks_through_somebodys_eyes_sees_the_others_and_not_that_head():
    me, other = stand(0.0, 1.3), stand(0.0, -1.3, "two")
    eyes = float(me.model.skeleton.rest_joints[HEAD, 1]) + 0.05
    for forward, through in ((0.0, True), (0.3, True), (-1.0, False)):
        camera = orbit_camera((0.0, eyes, -1.3), 2.6 - forward, 0.0, 0.0, 96, 96)
        both = SceneRenderer().render(Scene(ROOM, (me, other)), camera).copy()
        alone = SceneRenderer().render(Scene(ROOM, (other,)), camera)
        middle = (slice(40, 56), slice(40, 56))
        assert (both[middle] == alone[middle]).all() == through


def test_the_nearer_person_hides_the_other():
    camera = orbit_camera((0, 0.8, 0), 4.0, 0.0, 0.05, 96, 96)
    alone = SceneRenderer().render(Scene(ROOM, (stand(0.0, 1.0),)), camera).copy()
    both = SceneRenderer().render(Scene(ROOM, (stand(0.0, 1.0), stand(0.0, -1.0, "two"))), camera)
    middle = (slice(46, 52), slice(44, 52))
    # a little of what is behind shines through between splats
    assert np.abs(alone[middle].astype(int) - both[middle].astype(int)).max() <= 12


def test_placement_moves_and_turns_a_person():
    camera = orbit_camera((0, 0.8, 0), 4.0, 0.0, 0.05, 96, 96)
    left = SceneRenderer().render(Scene(ROOM, (stand(-0.8, 0.0),)), camera).copy()
    right = SceneRenderer().render(Scene(ROOM, (stand(0.8, 0.0),)), camera)
    assert left[40:60, 15:35, 1].std() > 3 * max(left[40:60, 60:80, 1].std(), 1)
    assert right[40:60, 60:80, 1].std() > 3 * max(right[40:60, 15:35, 1].std(), 1)
    back = SceneRenderer().render(Scene(ROOM, (stand(0.8, 0.0, yaw=np.pi),)), camera)
    blue = (
        back[40:60, 62:78, 2].mean()
        - SceneRenderer().render(Scene(ROOM, (stand(0.8, 0.0),)), camera)[40:60, 62:78, 2].mean()
    )
    assert blue > 30  # the back is blue


def test_shadows_fade_with_the_height_of_the_foot():
    performer = stand(0.5, 0.0)
    on_floor = contact_shadows(ROOM, [performer])
    lifted = Performer(
        "one",
        performer.model,
        performer.position,
        0.0,
        Pose(np.zeros((24, 3)), np.array([0, 0.2, 0])),
    )
    assert on_floor.shape == (2, 4)
    np.testing.assert_allclose(on_floor[:, 3], ROOM.shadow_strength, rtol=1e-6)
    assert (contact_shadows(ROOM, [lifted])[:, 3] < 0.5 * on_floor[:, 3]).all()


@pytest.mark.parametrize("size", [(17, 33), (64, 16)])
def test_any_size_is_drawn(size):
    width, height = size
    picture = SceneRenderer().render(
        Scene(ROOM, (stand(0, 0),)), orbit_camera((0, 0.8, 0), 4.0, 1.0, 0.1, width, height)
    )
    assert picture.shape == (height, width, 3)


def test_a_picture_in_parts_is_the_picture_as_a_whole():
    stage, camera = SceneRenderer(), orbit_camera((0, 0.8, 0), 5.0, 0.0, 0.3, 160, 128)
    before = stage.render(Scene(ROOM, (stand(-0.6, 0.0),)), camera).copy()
    assert stage.changed.all()
    for x in (-0.4, 0.1, 0.9):
        scene = Scene(ROOM, (stand(x, 0.0),))
        after = stage.render(scene, camera)
        np.testing.assert_allclose(after.astype(int), SceneRenderer().render(scene, camera), atol=1)
        differs = (before != after).any(axis=2).reshape(8, 16, 10, 16).any(axis=(1, 3))
        assert not (differs & ~stage.changed).any()
        assert stage.changed.mean() < 0.6
        before = after.copy()
    stage.render(Scene(ROOM, ()), camera)
    assert stage.changed.any()  # where somebody was is the room again
    stage.render(Scene(ROOM, ()), camera)
    assert not stage.changed.any()


def test_another_view_or_place_is_drawn_whole():
    stage, camera = SceneRenderer(), orbit_camera((0, 0.8, 0), 5.0, 0.0, 0.3, 64, 64)
    people = (stand(0.0, 0.0),)
    stage.render(Scene(ROOM, people), camera)
    for scene, view in (
        (Scene(ROOM, people), orbit_camera((0, 0.8, 0), 5.0, 0.1, 0.3, 64, 64)),
        (Scene(Environment(floor=(0.2, 0.3, 0.4)), people), camera),
    ):
        stage.render(Scene(ROOM, people), camera)
        np.testing.assert_array_equal(
            stage.render(scene, view), SceneRenderer().render(scene, view)
        )
        assert stage.changed.all()


def test_shadows_lie_in_their_blocks_however_the_viewer_stands():
    shadows = np.array([[0.0, 0.0, 0.3, 0.45], [1.5, 0.5, 0.2, 0.3]], np.float32)
    nothing = np.zeros((96, 96, 4), np.float32)
    dark, light = np.zeros((96, 96, 3), np.uint8), np.zeros((96, 96, 3), np.uint8)
    from renderer.compositing.backdrop_kernels import compose

    for azimuth in np.linspace(0.0, 6.0, 7):
        for distance in (0.4, 1.5, 4.0):
            camera = orbit_camera((0, 0.8, 0), distance, azimuth, 0.3, 96, 96)
            view = (camera.intrinsics, camera.rotation, camera.position, COLOURS)
            compose(dark, nothing, *view, shadows, np.ones((6, 6), bool))
            compose(light, nothing, *view, shadows[:0], np.ones((6, 6), bool))
            # what is fainter may still turn a byte that was about to change
            darker = light.astype(int) - dark > 1
            differs = darker.any(axis=2).reshape(6, 16, 6, 16).any(axis=(1, 3))
            assert not (differs & ~shadow_blocks(shadows, camera)).any()


def test_geometry_tells_how_far_people_are_and_which_way_they_face():
    camera = orbit_camera((0, 0.8, 0), 4.0, 0.0, 0.05, 96, 96)
    stage = SceneRenderer()
    for z in (0.0, 1.0):
        geometry = stage.geometry(Scene(ROOM, (stand(0.0, z),)), camera)
        solid = geometry.alpha > 0.8
        depth = np.median(geometry.depth[solid] / geometry.alpha[solid])
        assert depth == pytest.approx(4.0 - z, abs=0.3)
    for yaw in (0.0, 0.7):
        geometry = stage.geometry(Scene(ROOM, (stand(0.0, 1.0, yaw=yaw),)), camera)
        normal = np.median(geometry.normal[solid] / geometry.alpha[solid][:, None], axis=0)
        # these splats lie in planes of constant z
        np.testing.assert_allclose(normal, [np.sin(yaw), 0.0, np.cos(yaw)], atol=0.05)
    nobody = stage.geometry(Scene(ROOM, ()), camera)
    assert not nobody.alpha.any()


def test_geometry_of_a_field_is_refused_in_words():
    picture = Performer(
        "Ada", cast(PerformerModel, SimpleNamespace(splats=None)), np.zeros(3), 0.0, Pose.rest()
    )
    camera = orbit_camera((0, 0.8, 0), 4.0, 0.0, 0.05, 32, 32)
    with pytest.raises(InvalidInput, match="performers who are splats; got 'Ada'"):
        SceneRenderer().geometry(Scene(ROOM, (picture,)), camera)


def test_loose_clothes_swing_as_time_goes_on_and_come_to_rest():
    camera, model = orbit_camera((0, 0.8, 0), 3.0, 0.4, 0.1, 96, 96), make_loose_model()

    def picture(stage: SceneRenderer, turn: float, time_s: float) -> np.ndarray:
        angles = np.zeros((24, 3))
        angles[0, 1] = turn
        pose = Pose(angles, np.zeros(3), time_s)
        person = Performer("one", model, np.zeros(3), 0.0, pose)
        return stage.render(Scene(ROOM, (person,)), camera).astype(int)

    stage, other = SceneRenderer(), SceneRenderer()
    picture(stage, 0.0, 0.0)
    swinging = picture(stage, 0.7, 0.05)
    settled = picture(other, 0.7, 0.05)
    assert np.abs(swinging - settled).max() > 60
    for number in range(150):
        swinging = picture(stage, 0.7, 0.1 + number / 30.0)
    assert np.abs(swinging - settled).mean() < 0.05
