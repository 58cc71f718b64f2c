"""The real estimator behind the Protocol, and where its landmarks lie on the body."""

from __future__ import annotations

import numpy as np
import pytest

from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import MIRROR, load_body_landmarks
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks, MediaPipeEstimator, PoseEstimator
from capture.detection.tracking import track_person
from capture.sources.video import read_video
from scene.skeleton import JOINT_NAMES
from tests.capture.people import LANDMARK
from tests.shared_data import shared_data


@pytest.fixture(scope="module")
def estimator(pose_model):
    with MediaPipeEstimator(pose_model) as found:
        yield found


@pytest.fixture(scope="module")
def clip():
    return read_video(shared_data("real-two-cameras/cam01.mp4"), max_frames=3)


def test_it_fits_the_protocol_and_finds_the_subject(estimator, clip):
    asked: PoseEstimator = estimator
    people = asked.detect(clip.images[0])
    assert people
    person = people[0]
    assert person.pixels.shape == (33, 2)
    assert person.mask.shape == clip.images[0].shape[:2]
    assert 0.0 <= person.mask.min() <= person.mask.max() <= 1.0
    # y down in pixels, feet below the nose; the person faces the camera: their left is at the right
    assert person.pixels[LANDMARK["left_ankle"], 1] > person.pixels[LANDMARK["nose"], 1]
    assert person.world[LANDMARK["left_shoulder"], 0] > person.world[LANDMARK["right_shoulder"], 0]


def test_an_empty_wall_holds_nobody(estimator):
    assert estimator.detect(np.full((240, 320, 3), 128, dtype=np.uint8)) == []


def test_the_real_subject_is_followed_past_those_behind(estimator, clip):
    track = track_person(clip.images, estimator)
    assert track.found.all()
    for person in track.people:
        assert person is not None
        middle = 0.5 * (person.box[0] + person.box[2])
        assert middle > 0.25 * clip.images[0].shape[1]  # somebody else stands at the left border
        assert person.box[3] - person.box[1] > 300


def test_moving_a_window_back_keeps_the_person_in_place():
    person = Landmarks(
        np.full((33, 2), 5.0), np.zeros((33, 3)), np.ones(33), np.ones((10, 10), np.float32)
    )
    moved = person.moved(20, 30, 64, 48)
    assert moved.pixels[0] == pytest.approx([25.0, 35.0])
    assert moved.mask.shape == (48, 64)
    assert moved.mask.sum() == 100
    assert moved.mask[30:40, 20:30].min() == 1.0


def test_landmarks_lie_on_the_body_and_mirror_each_other():
    marks, model = load_body_landmarks(), load_body_model()
    assert len(marks.rest) == len(LANDMARK_NAMES)
    for index, twin in enumerate(MIRROR):
        assert marks.rest[twin] == pytest.approx(marks.rest[index] * [-1.0, 1.0, 1.0], abs=0.01)
        near = np.linalg.norm(model.rest_vertices - marks.rest[index], axis=1).min()
        assert near < 0.12
    nose, heel = marks.rest[LANDMARK["nose"]], marks.rest[LANDMARK["left_heel"]]
    toe = marks.rest[LANDMARK["left_foot_index"]]
    assert nose[2] > 0.1
    assert heel[2] < 0.0 < toe[2]
    assert JOINT_NAMES[marks.joints[LANDMARK["nose"]]] == "head"


def test_shape_moves_the_landmarks_with_the_body():
    marks = load_body_landmarks()
    taller = marks.rest + marks.directions @ np.array([0.1, 0.0, 0.0, 0.0, 0.0])
    assert taller[LANDMARK["nose"], 1] > marks.rest[LANDMARK["nose"], 1] + 0.05
    assert taller[LANDMARK["left_shoulder"], 1] > marks.rest[LANDMARK["left_shoulder"], 1] + 0.04
