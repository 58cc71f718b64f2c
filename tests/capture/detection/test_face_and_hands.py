"""Faces and hands found in pictures of a studio performer, against what they did."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.detection.clip_expressions import clip_expressions
from capture.detection.face_and_hands import (
    ClipParts,
    FaceAndHandDetector,
    FoundHand,
    PartLandmarks,
    PartsAside,
    assign_hands,
)
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.detection.rigid_parts import rigid_parts
from capture.errors import PoseModelMissing
from capture.storage import open_sequence
from capture.studio import make_sequence
from scene.arrays import Array, UInt8
from scene.expression import EXPRESSION_NAMES, PARTS
from scene.rotations import matrix_to_axis_angle
from scene.sequence import Sequence
from scene.skeleton import JOINT_NAMES

FRAMES = 24
HEAD = JOINT_NAMES.index("head")
JAW = EXPRESSION_NAMES.index("jaw_open")


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Head and shoulders of somebody who talks and blinks, facing the camera."""
    out = tmp_path_factory.mktemp("studio") / "talking"
    make_sequence(
        out,
        seed=0,
        frames=FRAMES,
        size=256,
        test_cameras=1,
        turn_deg=20.0,
        frames_per_second=6.0,
        expressions=True,
        framing="head",
    )
    return open_sequence(out)


@pytest.fixture(scope="module")
def pictures(filmed: Sequence) -> list[UInt8[Array, "H W 3"]]:
    frames = [filmed.frame(index) for index in range(FRAMES)]
    shown = [frame.image + 0.5 * (1.0 - frame.mask[..., None]) for frame in frames]
    return [np.rint(255.0 * np.clip(one, 0.0, 1.0)).astype(np.uint8) for one in shown]


@pytest.fixture(scope="module")
def people(pictures: list[UInt8[Array, "H W 3"]], pose_model: Path) -> list[Landmarks | None]:
    with MediaPipeEstimator(pose_model) as estimator:
        found = [estimator.detect(picture) for picture in pictures]
    return [one[0] if one else None for one in found]


def _found(
    face_model: Path | None,
    hand_model: Path | None,
    pictures: list[UInt8[Array, "H W 3"]],
    people: list[Landmarks | None],
) -> ClipParts:
    with PartsAside(face_model, hand_model) as aside:
        for frame, (picture, person) in enumerate(zip(pictures, people, strict=True)):
            if person is not None:
                aside.look(frame, picture, person)
        return aside.found(len(pictures))


def test_a_mouth_is_seen_to_open_as_it_did(filmed, pictures, people, face_model, hand_model):
    parts = _found(face_model, hand_model, pictures, people)
    shown = clip_expressions(parts, filmed.motion.times_s, [0] * FRAMES)
    truth = filmed.motion.expressions[:FRAMES]
    assert np.ptp(truth[:, JAW]) > 0.5  # else nothing is tested
    assert np.corrcoef(shown[:, JAW], truth[:, JAW])[0, 1] > 0.95
    assert np.abs(shown[:, JAW] - truth[:, JAW]).mean() < 0.1
    assert ((shown >= 0.0) & (shown <= 1.0)).all()


def test_a_head_is_seen_to_turn_as_it_did(filmed, pictures, people, face_model):
    parts = _found(face_model, None, pictures, people)
    camera, skeleton = filmed.train.camera(0), filmed.body.skeleton
    found = rigid_parts(parts, camera.focal_px, camera.intrinsics[:2, 2])
    to_opengl = np.diag(OPENCV_TO_OPENGL) @ camera.rotation
    errors = []
    for frame in np.flatnonzero(found.turned[:, 0]).tolist():
        pose = filmed.train.pose(frame)
        head = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[HEAD, :3, :3]
        error = found.rotations[frame, 0].T @ to_opengl @ head
        errors.append(float(np.linalg.norm(matrix_to_axis_angle(error))))
    assert len(errors) > 0.8 * FRAMES
    assert np.degrees(np.median(errors)) < 8.0


def test_nothing_is_found_of_who_is_lost_or_hidden(pictures, people, face_model, hand_model):
    first = next(one for one in people if one is not None)
    away = replace(first, visibility=np.zeros(33), pixels=first.pixels + 4000.0)
    parts = _found(face_model, hand_model, pictures[:2], [None, away])
    assert parts.faces == [None, None]
    assert parts.hands == ([None, None], [None, None])


def test_without_models_nothing_is_found(pictures, people):
    parts = _found(None, None, pictures[:3], people[:3])
    assert not clip_expressions(parts, np.arange(3.0), [0, 0, 0]).any()


def test_a_file_that_is_no_model_is_refused_by_name(tmp_path: Path):
    path = tmp_path / "face.task"
    path.write_bytes(b"none")
    with pytest.raises(PoseModelMissing, match=r"MediaPipe \.task file; got .*face\.task"):
        FaceAndHandDetector(path, None)


WRISTS, EXTENT = np.array([[300.0, 200.0], [100.0, 200.0]]), 100.0


def hand_at(x: float, said: str) -> tuple[PartLandmarks, str]:
    return PartLandmarks(np.tile([x, 200.0], (21, 1)), np.zeros((21, 3))), said


def found_at(pair: tuple[FoundHand | None, FoundHand | None]) -> list[float | None]:
    return [None if hand is None else float(hand.landmarks.pixels[0, 0]) for hand in pair]


def test_hands_go_to_the_wrists_that_they_are_nearest_to():
    seen = [hand_at(110.0, "right"), hand_at(280.0, "left")]
    pair = assign_hands(seen, WRISTS, EXTENT)
    assert found_at(pair) == [280.0, 110.0]
    assert all(hand is not None and hand.side_agreed for hand in pair)


def test_one_hand_found_twice_is_one():
    seen = [hand_at(300.0, "left"), hand_at(305.0, "left")]
    together = np.array([[300.0, 200.0], [310.0, 200.0]])
    assert found_at(assign_hands(seen, together, EXTENT)) == [300.0, None]


def test_where_wrists_meet_the_network_tells_the_sides_apart():
    seen = [hand_at(300.0, "right"), hand_at(340.0, "left")]
    together = np.array([[320.0, 200.0], [322.0, 200.0]])
    assert found_at(assign_hands(seen, together, EXTENT)) == [340.0, 300.0]


def test_a_hand_far_from_both_wrists_is_somebody_elses():
    assert assign_hands([hand_at(500.0, "left")], WRISTS, EXTENT) == (None, None)
    assert assign_hands([], WRISTS, EXTENT) == (None, None)


def fist(curl: float) -> FoundHand:
    """A hand whose fingers are bent by `curl`, roughly."""
    points = np.zeros((21, 3))
    for finger in range(5):
        links = np.cumsum([0.09, 0.04, 0.03, 0.02]) * (1.0 - 0.5 * curl)
        points[1 + 4 * finger : 5 + 4 * finger] = np.stack(
            [links, np.full(4, 0.02 * finger), np.array([0.0, 0.0, 0.03, 0.05]) * curl], axis=1
        )
    return FoundHand(PartLandmarks(np.zeros((21, 2)), points), side_agreed=True)


def test_a_fist_does_not_open_while_it_is_missed():
    hands = [fist(1.0), None, fist(0.0), None, None]
    parts = ClipParts([None] * 5, (hands, [None] * 5))
    moved = clip_expressions(parts, np.arange(5.0), [0, 0, 0, 0, 1])
    curl = moved[:, EXPRESSION_NAMES.index("left_index_curl")]
    assert curl[0] > curl[1] > curl[2]
    assert curl[1] == pytest.approx(0.5 * (curl[0] + curl[2]))
    assert curl[3] == curl[2]
    assert curl[4] == 0.0  # another take
    assert not moved[:, PARTS["right_hand"]].any()
