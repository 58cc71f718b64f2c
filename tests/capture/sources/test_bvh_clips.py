"""Real motion capture of all three skeleton families on the 24 joints."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from capture.body.model import load_body_model
from capture.sources.bvh import parse_bvh, read_bvh
from scene import JOINT_NAMES, Motion, Skeleton
from tests.shared_data import shared_data

CLIPS = {
    "bend_scoop_lift_arm_02_06": "ASF",
    "dance_indian_94_15": "MB",
    "dance_turn_on_spot_94_14": "DAZ",
    "forward_jump_13_32": "DAZ",
    "jump_balance_02_04": "ASF",
    "jumps_turn_around_01_01": "ASF",
    "walk_figure8_91_62": "MB",
    "walk_veer_left_16_11": "MB",
    "wash_self_02_10": "ASF",
    "wave_hello_141_16": "MB",
}
LIMBS = {
    "MB": [
        f"{side}{part}"
        for part in ("UpLeg", "Leg", "Foot", "Arm", "ForeArm", "Hand")
        for side in ("Left", "Right")
    ],
    "DAZ": [
        f"{side}{part}"
        for part in ("Thigh", "Shin", "Foot", "Shldr", "ForeArm", "Hand")
        for side in ("l", "r")
    ],
    "ASF": [
        f"{side}{part}"
        for part in ("femur", "tibia", "foot", "humerus", "radius", "wrist")
        for side in ("l", "r")
    ],
}
"""Of the file, in the order of OURS."""
OURS = [
    f"{side}_{part}"
    for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    for side in ("left", "right")
]


@cache
def skeleton() -> Skeleton:
    return load_body_model().body(np.zeros(5)).skeleton


@cache
def clip_motion(name: str) -> Motion:
    return read_bvh(shared_data(f"mocap/{name}.bvh"), skeleton())


@cache
def transforms(name: str) -> np.ndarray:
    """[F 24 4 4]"""
    motion = clip_motion(name)
    return skeleton().joint_transforms(motion.joint_angles, motion.root_translation)


def place(name: str, joint: str) -> np.ndarray:
    """[F 3]"""
    return transforms(name)[:, JOINT_NAMES.index(joint), :3, 3]


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize(("name", "family"), CLIPS.items())
def test_limbs_point_where_the_file_points(name, family):
    clip = parse_bvh(shared_data(f"mocap/{name}.bvh").read_text())
    _, placed = clip.world()
    theirs = [placed[:, clip.names.index(joint)] for joint in LIMBS[family]]
    for start, end in ((0, 2), (1, 3), (2, 4), (3, 5), (6, 8), (7, 9), (8, 10), (9, 11)):
        expected = unit(theirs[end] - theirs[start])
        got = unit(place(name, OURS[end]) - place(name, OURS[start]))
        off = np.rad2deg(np.arccos(np.clip((got * expected).sum(-1), -1.0, 1.0)))
        assert off.max() < 0.5, OURS[start]


@pytest.mark.parametrize("name", CLIPS)
def test_knees_bend_backwards(name):
    for side in ("left", "right"):
        thigh = unit(place(name, f"{side}_knee") - place(name, f"{side}_hip"))
        shin = unit(place(name, f"{side}_ankle") - place(name, f"{side}_knee"))
        bent = (thigh * shin).sum(-1) < np.cos(np.deg2rad(25.0))
        forward = transforms(name)[:, JOINT_NAMES.index(f"{side}_hip"), :3, 2]
        assert ((shin * forward).sum(-1)[bent] < 0.0).all()


@pytest.mark.parametrize("name", CLIPS)
def test_feet_touch_the_floor_and_stay_above_it(name):
    lowest = np.full(len(clip_motion(name)), np.inf)
    for joint in ("left_ankle", "right_ankle", "left_foot", "right_foot"):
        rest = skeleton().rest_joints[JOINT_NAMES.index(joint), 1]
        lowest = np.minimum(lowest, place(name, joint)[:, 1] - rest)
    # nothing locks the feet: a dancer's stretched foot may sink for an instant, nobody's for long
    assert lowest.min() > -0.08
    assert np.percentile(lowest, 5) > -0.02
    assert (np.abs(lowest) < 0.03).mean() > 0.7


@pytest.mark.parametrize(
    "name",
    ["bend_scoop_lift_arm_02_06", "jump_balance_02_04", "wash_self_02_10", "forward_jump_13_32"],
)
def test_soles_are_level_while_somebody_stands(name):
    for side in ("left", "right"):
        up = transforms(name)[:, JOINT_NAMES.index(f"{side}_ankle"), 1, 1]
        height = place(name, f"{side}_foot")[:, 1]
        still = np.abs(np.gradient(height)) < 0.002
        assert np.rad2deg(np.arccos(np.median(up[still]))) < 10.0


@pytest.mark.parametrize("name", CLIPS)
def test_heads_look_ahead_and_up(name):
    """Mostly upright, whatever the body does: a crown below the ears would be a broken neck."""
    up = transforms(name)[:, JOINT_NAMES.index("head"), 1, 1]
    assert np.median(up) > 0.7


def test_known_turn_of_the_jumper():
    """188 degrees within half a metre about seven to nine seconds into the source's cut."""
    motion = clip_motion("jumps_turn_around_01_01")
    forward = transforms("jumps_turn_around_01_01")[:, 0, :3, 2]
    yaw = np.rad2deg(np.unwrap(np.arctan2(forward[:, 0], forward[:, 2])))
    assert 150.0 < np.ptp(yaw[motion.times_s < 10.0]) < 240.0


def test_dancer_turns_more_than_twice():
    forward = transforms("dance_indian_94_15")[:, 0, :3, 2]
    yaw = np.rad2deg(np.unwrap(np.arctan2(forward[:, 0], forward[:, 2])))
    assert np.ptp(yaw) == pytest.approx(809.0, abs=15.0)


def test_walking_speed_is_a_persons():
    path = place("walk_figure8_91_62", "pelvis")[:, [0, 2]]
    seconds = clip_motion("walk_figure8_91_62").duration_s
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1).sum() / seconds
    assert 0.6 < speed < 1.8  # m/s
