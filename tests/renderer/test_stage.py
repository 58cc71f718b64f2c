"""Scenes: the room's kernel against its twin, people before and behind each other, shadows."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.reference import backdrop as twin
from renderer.stage import Stage, contact_shadows
from scene import Environment, Performer, Pose, Scene, orbit_camera
from tests.renderer.studio import make_model

ROOM = Environment()
COLOURS = np.array([ROOM.horizon, ROOM.zenith, ROOM.floor], np.float32)


def stand(x: float, z: float, name: str = "one", yaw: float = 0.0) -> Performer:
    return Performer(name, make_model(), np.array([x, 0.0, z]), yaw, Pose.rest())


def test_the_room_matches_its_twin():
    from renderer.backdrop_kernels import compose

    camera = orbit_camera((0, 0.8, 0), 3.0, 0.5, 0.2, 80, 56)
    rng = np.random.default_rng(0)
    rgba = rng.uniform(0, 0.7, (56, 80, 4)).astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:]
    shadows = np.array([[0.1, -0.2, 0.3, 0.5], [0.5, 0.4, 0.2, 0.3]], np.float32)
    out = np.zeros((56, 80, 3), np.uint8)
    compose(out, rgba, camera.intrinsics, camera.rotation, camera.position, COLOURS, shadows)
    slow = twin.compose(rgba, camera, COLOURS.astype(np.float64), shadows)
    difference = np.abs(out.astype(int) - slow.astype(int))
    assert np.percentile(difference, 99) <= 1
    assert difference.max() <= 6  # a grid line's edge may fall on either side


def test_sky_is_above_floor():
    picture = Stage().render(Scene(ROOM, ()), orbit_camera((0, 0.8, 0), 3.0, 0.0, 0.05, 64, 64))
    assert picture.shape == (64, 64, 3)
    assert picture[2].mean(axis=0)[2] > picture[2].mean(axis=0)[0]  # the zenith is blue
    assert picture[-2].mean() < picture[30].mean()  # the floor is darker than the horizon


def test_the_nearer_person_hides_the_other():
    camera = orbit_camera((0, 0.8, 0), 4.0, 0.0, 0.05, 96, 96)
    alone = Stage().render(Scene(ROOM, (stand(0.0, 1.0),)), camera).copy()
    both = Stage().render(Scene(ROOM, (stand(0.0, 1.0), stand(0.0, -1.0, "two"))), camera)
    middle = (slice(46, 52), slice(44, 52))
    # a little of what is behind shines through between splats
    assert np.abs(alone[middle].astype(int) - both[middle].astype(int)).max() <= 12


def test_placement_moves_and_turns_a_person():
    camera = orbit_camera((0, 0.8, 0), 4.0, 0.0, 0.05, 96, 96)
    left = Stage().render(Scene(ROOM, (stand(-0.8, 0.0),)), camera).copy()
    right = Stage().render(Scene(ROOM, (stand(0.8, 0.0),)), camera)
    assert left[40:60, 15:35, 1].std() > 3 * max(left[40:60, 60:80, 1].std(), 1)
    assert right[40:60, 60:80, 1].std() > 3 * max(right[40:60, 15:35, 1].std(), 1)
    back = Stage().render(Scene(ROOM, (stand(0.8, 0.0, yaw=np.pi),)), camera)
    blue = (
        back[40:60, 62:78, 2].mean()
        - Stage().render(Scene(ROOM, (stand(0.8, 0.0),)), camera)[40:60, 62:78, 2].mean()
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
    picture = Stage().render(
        Scene(ROOM, (stand(0, 0),)), orbit_camera((0, 0.8, 0), 4.0, 1.0, 0.1, width, height)
    )
    assert picture.shape == (height, width, 3)
