"""Cloth: the kernel against its twin and against the balance of its forces; it hangs, keeps its
length, stays out of limbs and swings after a turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.reference.cloth import step as slow_step
from renderer.splats.cloth.tubes import STEP_S, steps_of
from scene import Motion, Pose
from scene.rotations import axis_angle_to_matrix
from tests.renderer.splats.cloth.wear import RINGS, SIDES, make_tubes
from tests.renderer.studio import make_body, make_motion

SKELETON = make_body().skeleton


def transforms_of(motion: Motion) -> np.ndarray:
    return steps_of(motion, SKELETON)[1]


def standing(seconds: float) -> np.ndarray:
    rest = [Pose.rest(time) for time in (0.0, seconds)]
    return transforms_of(Motion.from_poses(rest))


def test_a_step_is_that_of_its_twin():
    cloth, path = make_tubes(), transforms_of(make_motion(6))
    rng = np.random.default_rng(0)
    current = cloth.at_rest(path[5]) + rng.normal(scale=0.02, size=cloth.rest.shape)
    previous = current - rng.normal(scale=0.01, size=current.shape)
    slow = slow_step(cloth, current, previous, path[9])
    fast = cloth.stepped(current, previous, path[9:10])[0]
    np.testing.assert_allclose(fast, slow, atol=1e-12)
    assert np.abs(fast - cloth.at_rest(path[9])).max() > 0.01


def test_a_thread_comes_to_rest_where_spring_gravity_and_its_length_balance():
    cloth = make_tubes(spring=30.0, drag=4.0, smoothing=0.0)
    one = replace(
        cloth,
        rest=cloth.rest[: 2 * SIDES],
        tubes=np.array([[0, 0, 2, SIDES]], np.int64),
        ends=np.zeros((0, 2, 3)),
        movers=np.zeros((0, 2), np.int64),
        radii=np.zeros(0),
        owners=np.zeros(0, np.int64),
    )
    still = np.eye(4)[None].repeat(24, axis=0)[None].repeat(600, axis=0)
    settled = one.stepped(one.rest.copy(), one.rest.copy(), still)[-1]
    upper, lower = settled[:SIDES], settled[SIDES:]
    thread = lower - upper
    np.testing.assert_allclose(np.linalg.norm(thread, axis=1), one.lengths[SIDES:], rtol=1e-9)
    pull = 30.0 * (one.rest[SIDES:] - lower) + [0.0, -9.81, 0.0]
    np.testing.assert_allclose(np.cross(pull, thread), 0.0, atol=1e-3)
    assert (lower[:, 1] < one.rest[SIDES:, 1]).all()


def test_it_hangs_below_where_the_joint_alone_would_take_it_and_comes_to_rest():
    cloth = make_tubes()
    path = cloth.over(standing(0.5))
    hem = slice((RINGS - 1) * SIDES, RINGS * SIDES)
    assert (path[-1, hem, 1] - cloth.rest[hem, 1]).mean() < -0.005
    assert np.abs(path[-1] - path[-2]).max() < 1e-3
    np.testing.assert_array_equal(path[-1, :SIDES], cloth.rest[:SIDES])


def test_it_stays_outside_the_limb_inside():
    cloth, path = make_tubes(), transforms_of(make_motion(6))
    for vertices, posed in zip(cloth.over(path), path, strict=True):
        start, end = (
            posed[joint][:3, :3] @ place + posed[joint][:3, 3]
            for joint, place in zip(cloth.movers[0], cloth.ends[0], strict=True)
        )
        bone, skirt = end - start, vertices[SIDES : RINGS * SIDES]
        along = np.clip((skirt - start) @ bone / (bone @ bone), 0.0, 1.0)
        away = np.linalg.norm(skirt - start - along[:, None] * bone, axis=1)
        assert away.min() > 0.9 * cloth.radii[0]


def test_after_a_sudden_turn_the_hem_lags_and_follows():
    path = standing(2.0)
    turn = np.eye(4)
    turn[:3, :3] = axis_angle_to_matrix(np.array([0.0, 0.6, 0.0]))
    path[10:] = turn @ path[10:]
    cloth = make_tubes(smoothing=0.3)
    hem = cloth.over(path)[:, (RINGS - 1) * SIDES]
    angle = np.arctan2(-hem[:, 2], hem[:, 0])
    assert angle[11] < 0.3
    assert angle[11] < angle[16]
    assert abs(angle[-1] - 0.6) < 0.15


def test_the_same_motion_swings_the_same_way_at_sixty_steps_a_second():
    path = transforms_of(make_motion(6))
    assert len(path) == round(0.5 / STEP_S) + 1
    first, again = (make_tubes().over(path) for _ in range(2))
    np.testing.assert_array_equal(first, again)
