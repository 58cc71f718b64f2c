"""The keypoints file: both layouts, and refusals that name the place."""

from __future__ import annotations

import json

import numpy as np
import pytest

from capture.body.model import load_body_model
from capture.errors import BrokenKeypoints
from capture.sources.keypoints import parse_keypoints, read_keypoints
from scene.skeleton import Skeleton
from tests.capture.people import JOINT, body, landmark_positions, standing, up_is_down


def _smpl(frames: int = 3, **changed) -> dict:
    motion = standing(frames)
    return {
        "format": "metanerf-keypoints",
        "version": 1,
        "layout": "smpl24",
        "frames_per_second": 30,
        "frames": [
            {
                "time_s": float(motion.times_s[i]),
                "joint_angles": motion.joint_angles[i].tolist(),
                "root_translation": [0.0, 0.1 * i, 0.0],
            }
            for i in range(frames)
        ],
    } | changed


def _mediapipe(frames: int = 3) -> dict:
    person, motion = body(), standing(frames)
    rows = []
    for index in range(frames):
        points = up_is_down(landmark_positions(person, motion.pose(index)))
        points -= points[[23, 24]].mean(axis=0)
        rows.append({"landmarks": [[*point, 1.0] for point in points.tolist()]})
    return _smpl(1) | {"layout": "mediapipe33", "frames": rows}


def test_smpl_joints_are_read_as_they_are(tmp_path):
    path = tmp_path / "motion.json"
    path.write_text(json.dumps(_smpl()))
    motion = read_keypoints(path)
    assert motion.joint_angles == pytest.approx(standing(3).joint_angles)
    assert motion.root_translation[:, 1] == pytest.approx([0.0, 0.1, 0.2])
    assert motion.confidence.min() == 1.0


def test_landmarks_are_solved_to_joint_angles():
    motion = parse_keypoints(_mediapipe(5))
    truth = standing(5)
    skeleton = Skeleton(load_body_model().rest_joints)
    still = np.zeros((5, 3))
    solved = skeleton.joint_transforms(motion.joint_angles, still)[..., :3, 3]
    wanted = skeleton.joint_transforms(truth.joint_angles, still)[..., :3, 3]
    assert np.linalg.norm(solved - wanted, axis=-1).mean() < 0.025
    assert motion.times_s == pytest.approx(np.arange(5) / 30.0)


def test_solved_people_stand_on_the_floor():
    motion = parse_keypoints(_mediapipe(5))
    skeleton = Skeleton(load_body_model().rest_joints)
    joints = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)[..., 1, 3]
    assert joints.min(axis=1) == pytest.approx(skeleton.rest_joints[:, 1].min(), abs=1e-6)


def test_visibility_becomes_confidence_and_hidden_legs_hang():
    data = _mediapipe(2)
    for frame in data["frames"]:
        for row in range(25, 33):
            frame["landmarks"][row][3] = 0.1
    motion = parse_keypoints(data)
    legs = [JOINT[n] for n in ("left_hip", "right_hip", "left_knee", "right_knee")]
    assert motion.joint_angles[:, legs] == pytest.approx(0.0)
    assert motion.confidence[:, JOINT["left_knee"]].max() < 0.2
    assert motion.confidence[:, JOINT["left_elbow"]].min() > 0.9


def test_visibility_and_times_may_be_left_out():
    data = _mediapipe(2)
    for frame in data["frames"]:
        frame["landmarks"] = [row[:3] for row in frame["landmarks"]]
    assert parse_keypoints(data).confidence.min() == 1.0


def _spoil(path: list, value) -> dict:
    data = _smpl()
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["format"], "bvh", "format must be 'metanerf-keypoints'; got 'bvh'"),
        (["version"], 2, "version must be 1; got 2"),
        (["layout"], "coco17", "layout must be one of smpl24, mediapipe33; got 'coco17'"),
        (["frames_per_second"], 0, "frames_per_second must be above 0"),
        (["frames"], [], "frames must be a list of 1 to"),
        (["frames", 1], 5, r"frames\[1\] must be an object; got int"),
        (
            ["frames", 1, "joint_angles"],
            [[0, 0, 0]],
            r"frames\[1\]\.joint_angles must have 24 rows",
        ),
        (
            ["frames", 2, "joint_angles", 7, 1],
            float("nan"),
            r"frames\[2\]\.joint_angles\[7\]\[1\] must be a finite number; got nan",
        ),
        (
            ["frames", 0, "root_translation", 2],
            float("inf"),
            r"frames\[0\]\.root_translation\[2\] must be a finite number; got inf",
        ),
        (["frames", 0, "joint_angles", 3], [1, 2], r"joint_angles\[3\] must have 3 numbers; got 2"),
        (["frames", 0, "joint_angles", 3, 0], "1", r"must be a finite number; got '1'"),
        (["frames", 0, "joint_angles", 3, 0], True, r"must be a finite number; got True"),
        (["frames", 2, "time_s"], 0.0, "times_s must increase"),
    ],
)
def test_broken_files_are_refused_with_the_place(path, value, message):
    with pytest.raises(BrokenKeypoints, match=message):
        parse_keypoints(_spoil(path, value))


def test_what_is_no_json_is_refused(tmp_path):
    path = tmp_path / "motion.json"
    path.write_bytes(b"\xff\xfe\x00 not json")
    with pytest.raises(BrokenKeypoints, match=r"motion\.json must be JSON"):
        read_keypoints(path)
    with pytest.raises(BrokenKeypoints, match="got no file"):
        read_keypoints(tmp_path / "absent.json")
    with pytest.raises(BrokenKeypoints, match="format must be"):
        parse_keypoints([1, 2])


def test_json_nested_without_end_is_refused(tmp_path):
    path = tmp_path / "motion.json"
    path.write_text("[" * 100_000)
    with pytest.raises(BrokenKeypoints, match="must be JSON"):
        read_keypoints(path)
