"""BVH: what a file says, and the same movement on the 24 joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from capture.body.model import load_body_model
from capture.errors import BrokenMotionCapture
from capture.sources.bvh import parse_bvh, read_bvh
from scene import JOINT_NAMES, Motion, Skeleton
from scene.rotations import axis_angle_to_matrix
from tests.capture.bvh_files import Bone, bvh_text, person


@pytest.fixture(scope="module")
def skeleton() -> Skeleton:
    return load_body_model().body(np.zeros(5)).skeleton


def read_text(tmp_path: Path, text: str, skeleton: Skeleton) -> Motion:
    path = tmp_path / "clip.bvh"
    path.write_text(text)
    return read_bvh(path, skeleton)


def transforms(motion: Motion, skeleton: Skeleton) -> np.ndarray:
    """[F 24 4 4]"""
    return skeleton.joint_transforms(motion.joint_angles, motion.root_translation)


def place(motion: Motion, skeleton: Skeleton, name: str) -> np.ndarray:
    """[F 3]"""
    return transforms(motion, skeleton)[:, JOINT_NAMES.index(name), :3, 3]


def way(motion: Motion, skeleton: Skeleton, start: str, end: str) -> np.ndarray:
    """Unit vectors [F 3] from joint `start` to joint `end`."""
    between = place(motion, skeleton, end) - place(motion, skeleton, start)
    return between / np.linalg.norm(between, axis=1, keepdims=True)


def test_rotation_order_is_read_from_the_file():
    arm = Bone("A", (0.0, 0.0, 0.0), (Bone("B", (1.0, 0.0, 0.0), (Bone("C", (0.0, 2.0, 0.0)),)),))
    for order, end in (
        # Rz(90) Rx(90): C's (0, 2, 0) goes to (0, 0, 2) and stays; B's (1, 0, 0) turns in A only
        ("Zrotation Yrotation Xrotation", [1.0, 0.0, 2.0]),
        # Rx(90) Rz(90), with the angles given in this order: (0, 2, 0) goes to (-2, 0, 0)
        ("Xrotation Yrotation Zrotation", [-1.0, 0.0, 0.0]),
    ):
        clip = parse_bvh(
            bvh_text(arm, [{"root": (0.0, 0.0, 0.0), "B": (90.0, 0.0, 90.0)}], order=order)
        )
        _, placed = clip.world()
        np.testing.assert_allclose(placed[0, 2], end, atol=1e-6)


def test_channels_offsets_and_times_are_read():
    clip = parse_bvh(
        bvh_text(
            person(), [{"root": (1.0, 2.0, 3.0)}, {"Hips": (0.0, 90.0, 0.0)}], frame_time_s=0.25
        )
    )
    assert clip.names[:3] == ("Hips", "LeftUpLeg", "LeftLeg")
    assert clip.parents[:3] == (-1, 0, 1)
    np.testing.assert_allclose(clip.offsets[2], [0.0, -40.0, 0.0])
    np.testing.assert_allclose(clip.positions, [[1.0, 2.0, 3.0], [0.0, 90.0, 0.0]])
    assert clip.frame_time_s == 0.25
    _, placed = clip.world()
    np.testing.assert_allclose(placed[0, 1], [11.0, -3.0, 3.0])
    # a quarter turn about y takes the left hip from +x to -z
    np.testing.assert_allclose(placed[1, 1], [0.0, 85.0, -10.0], atol=1e-6)


def test_t_pose_stays_the_t_pose(tmp_path, skeleton):
    motion = read_text(tmp_path, bvh_text(person(), [{}, {}]), skeleton)
    np.testing.assert_allclose(motion.joint_angles, 0.0, atol=1e-3)
    np.testing.assert_allclose(motion.root_translation, 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.times_s, [0.0, 0.1])


@pytest.mark.parametrize("degrees", [10.0, 45.0, 120.0])
def test_bent_knee_keeps_its_angle(tmp_path, skeleton, degrees):
    text = bvh_text(person(), [{}, {"LeftLeg": (0.0, 0.0, degrees)}])
    motion = read_text(tmp_path, text, skeleton)
    knee = motion.joint_angles[1, JOINT_NAMES.index("left_knee")]
    np.testing.assert_allclose(np.rad2deg(knee), [degrees, 0.0, 0.0], atol=0.1)
    thigh = way(motion, skeleton, "left_hip", "left_knee")[1]
    shin = way(motion, skeleton, "left_knee", "left_ankle")[1]
    np.testing.assert_allclose(np.rad2deg(np.arccos(thigh @ shin)), degrees, atol=0.1)
    assert shin[2] < 0.0  # heels go back


def test_limbs_take_the_direction_they_have_in_the_file(tmp_path, skeleton):
    apart = person(spread=30.0)
    upright = np.rad2deg(np.arctan2(15.0, 40.0))
    frames = [{}, {"LeftUpLeg": (-upright, 0.0, 0.0), "RightUpLeg": (upright, 0.0, 0.0)}]
    motion = read_text(tmp_path, bvh_text(apart, frames), skeleton)
    for side, out in (("left", 1.0), ("right", -1.0)):
        leg = way(motion, skeleton, f"{side}_hip", f"{side}_ankle")
        expected = np.array([out * 15.0, -40.0, 0.0]) / np.hypot(15.0, 40.0)
        np.testing.assert_allclose(leg[0], expected, atol=1e-3)
        np.testing.assert_allclose(leg[1], [0.0, -1.0, 0.0], atol=1e-3)


def test_soles_are_level_where_legs_stand_upright(tmp_path, skeleton):
    """A file may rest with legs apart; once they stand upright, so do the feet."""
    upright = np.rad2deg(np.arctan2(15.0, 40.0))
    frames = [{"LeftUpLeg": (-upright, 0.0, 0.0), "RightUpLeg": (upright, 0.0, 0.0)}]
    motion = read_text(tmp_path, bvh_text(person(spread=30.0), frames), skeleton)
    for name in ("left_ankle", "right_ankle", "left_foot", "right_foot"):
        turned = transforms(motion, skeleton)[0, JOINT_NAMES.index(name), :3, :3]
        np.testing.assert_allclose(turned, np.eye(3), atol=2e-3)


def test_rest_pose_of_a_tpose_file_is_used(tmp_path, skeleton):
    """The zero pose has the arms down; the file beside it raises them to the T-pose."""
    down, up = {"LeftArm": (-90.0, 0.0, 0.0)}, {}
    hanging = person()
    (tmp_path / "tpose").mkdir()
    (tmp_path / "tpose" / "clip.tpose.bvh").write_text(bvh_text(hanging, [down]))
    # against a rest whose left arm hangs, an arm held out was turned, and so is ours
    motion = read_text(tmp_path, bvh_text(hanging, [down, up]), skeleton)
    directions = way(motion, skeleton, "left_shoulder", "left_elbow")
    np.testing.assert_allclose(directions, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], atol=2e-3)


def test_root_moves_in_steps_of_the_performers_legs(tmp_path, skeleton):
    frames = [{"root": (100.0, 90.0, -50.0)}, {"root": (180.0, 90.0, -50.0)}]
    motion = read_text(tmp_path, bvh_text(person(), frames), skeleton)
    hip, ankle = (skeleton.rest_joints[JOINT_NAMES.index(n), 1] for n in ("left_hip", "left_ankle"))
    np.testing.assert_allclose(motion.root_translation[0], 0.0, atol=1e-6)
    # 80 units are one leg of the file, hence one leg of ours
    np.testing.assert_allclose(motion.root_translation[1], [hip - ankle, 0.0, 0.0], atol=1e-6)


def test_turn_of_the_root_turns_the_person(tmp_path, skeleton):
    motion = read_text(tmp_path, bvh_text(person(), [{}, {"Hips": (0.0, 90.0, 0.0)}]), skeleton)
    facing = axis_angle_to_matrix(motion.joint_angles[1, 0]) @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(facing, [1.0, 0.0, 0.0], atol=1e-3)


def test_feet_stand_on_the_floor_however_high_the_file_is(tmp_path, skeleton):
    frames = [{"root": (0.0, 500.0, 0.0)}] * 5
    motion = read_text(tmp_path, bvh_text(person(), frames), skeleton)
    ankle = JOINT_NAMES.index("left_ankle")
    np.testing.assert_allclose(
        place(motion, skeleton, "left_ankle")[:, 1], skeleton.rest_joints[ankle, 1], atol=1e-3
    )


GOOD = bvh_text(person(), [{}, {}])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a BVH file must hold HIERARCHY and MOTION; got ''"),
        ("not a clip", "a BVH file must hold HIERARCHY and MOTION; got 'not a clip'"),
        (GOOD.split("MOTION")[0], "a BVH file must hold HIERARCHY and MOTION"),
        (GOOD.replace("OFFSET 0.0 10.0 0.0", "OFFSET 0.0 ten 0.0"), "tree of joints; got .*'ten'"),
        (GOOD.replace("OFFSET", "WEIGHT"), "HIERARCHY must be a tree of joints; got unknown word"),
        (GOOD.replace("}", "", 3).replace("End Site", "} } } }"), "HIERARCHY must be a tree"),
        (GOOD.replace("Zrotation", "Wrotation", 1), "channels must be .*; got 'Wrotation'"),
        (GOOD.replace("Zrotation", "Zscale", 1), "channels must be .*; got 'Zscale'"),
        (GOOD.replace("90.000000", "high", 1), "MOTION must hold numbers only; got .*'high'"),
        (GOOD.replace("90.000000", "nan", 1), "every frame must hold 51 finite channels"),
        (GOOD.replace("90.000000", "90 90", 2), "every frame must hold 51 finite channels"),
        (GOOD.replace("90.000000", "90 90", 1), "MOTION must hold numbers only"),
        (GOOD.replace("Frames: 2", "Frames: 3"), "must hold the 3 frames it declares; got 2"),
        (GOOD.replace("Frame Time: 0.1", "Frame Time: 0"), "Frame Time must be positive; got 0.0"),
        (
            GOOD.replace("Frame Time: 0.1", "Frame Time: nan"),
            "Frame Time must be positive; got nan",
        ),
        (GOOD.replace("Frame Time: 0.1", ""), "MOTION must hold"),
        (GOOD.replace("LowerBack", "Backbone"), "skeleton must be of the family MB, DAZ, ASF; got"),
        (
            GOOD.replace("LeftLeg", "LeftTail"),
            "skeleton must have both legs; .*left_knee is missing",
        ),
    ],
)
def test_broken_files_say_what_is_wrong(tmp_path, skeleton, text, message):
    with pytest.raises(BrokenMotionCapture, match=message):
        read_text(tmp_path, text, skeleton)


def test_unreadable_files_are_named(tmp_path, skeleton):
    with pytest.raises(BrokenMotionCapture, match=r"gone\.bvh must be a readable BVH file; got"):
        read_bvh(tmp_path / "gone.bvh", skeleton)
    (tmp_path / "binary.bvh").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(BrokenMotionCapture, match=r"binary\.bvh must be a readable BVH file; got"):
        read_bvh(tmp_path / "binary.bvh", skeleton)
