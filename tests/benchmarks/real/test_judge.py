"""Figures of pictures whose faults are known."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from benchmarks.real.judge import Judge, TestFrame, flicker
from benchmarks.real.parts import LEFT_EYE, RIGHT_EYE, irises_in_eyes, part_finder
from benchmarks.real.ruler import Ruler
from capture.sources.video import read_video
from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips
from scene.camera import Camera
from scene.motion import Pose
from tests.shared_data import shared_data

CLIP = "patterned_shirt_eat"


@pytest.fixture(scope="module")
def frames() -> list[TestFrame]:
    ruler = Ruler.read(CLIP)
    path = ruler.require_footage(shared_data("real-webcam-people").parent)
    clip = read_video(path, max_frames=1000, max_side=4096)
    camera = Camera.from_field_of_view(np.eye(3, 4), *ruler.size, 0.8)
    return [
        TestFrame(
            "own_views",
            CLIP,
            index,
            clip.images[index],
            ruler.mask(index),
            ruler.hidden(index),
            ruler.face(index),
            tuple(ruler.hands(index)),
            camera,
            Pose.rest(float(index)),
        )
        for index in ruler.indices[:2]
    ]


@contextmanager
def judged():
    models = shared_data("models")
    face_and_hand = models / "face_landmarker.task", models / "hand_landmarker.task"
    with part_finder(*face_and_hand) as finder:
        yield Judge(Lpips(PACKAGED_BACKBONE), finder)


def _picture(frame: TestFrame) -> np.ndarray:
    return np.concatenate([frame.truth, frame.mask[..., None]], axis=2)


def _known(value: float | None) -> float:
    assert value is not None
    return value


def test_the_truth_is_equal_to_itself_and_its_face_is_found(frames):
    with judged() as judge:
        figures = judge.figures(_picture(frames[0]), frames[0])
    assert figures["body"] == {"psnr": 100.0, "ssim": pytest.approx(1.0), "lpips": 0.0, "iou": 1.0}
    assert figures["face"]["psnr"] == 100.0
    assert figures["face"]["found"] == 1.0
    assert _known(figures["face"]["points_percent"]) < 3.0
    assert _known(figures["face"]["irises_percent"]) < 5.0


def test_a_face_that_moved_or_is_gone_is_told_from_one_in_its_place(frames):
    frame = frames[0]
    assert frame.face is not None
    eyes = 0.1 * np.ptp(frame.face[:, 0])
    moved = np.roll(_picture(frame), round(eyes), axis=1)
    faceless = _picture(frame)
    top, left = frame.face.min(0).astype(int)[::-1] - 20
    bottom, right = frame.face.max(0).astype(int)[::-1] + 20
    faceless[top:bottom, left:right] = 0.0
    with judged() as judge:
        shifted, gone = judge.figures(moved, frame), judge.figures(faceless, frame)
    assert _known(shifted["face"]["points_percent"]) > 8.0
    assert gone["face"]["found"] == 0.0
    assert gone["face"]["points_percent"] is None
    assert gone["face"]["irises_percent"] is None
    assert _known(shifted["face"]["irises_percent"]) < 5.0
    assert _known(shifted["body"]["iou"]) < 0.97


def test_eyes_that_look_elsewhere_are_told_from_a_head_that_turned_in_the_picture(frames):
    face = frames[0].face
    assert face is not None
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    moved = 1.3 * (face - face.mean(axis=0)) @ turn.T + [300.0, 200.0]
    assert irises_in_eyes(moved) == pytest.approx(irises_in_eyes(face), abs=1e-9)
    looking = face.copy()
    for corners, iris in ((LEFT_EYE, 473), (RIGHT_EYE, 468)):
        looking[iris] += 0.2 * (face[corners[1]] - face[corners[0]])
    assert irises_in_eyes(looking) - irises_in_eyes(face) == pytest.approx(
        np.array([[0.2, 0.0], [0.2, 0.0]]), abs=1e-9
    )


def test_what_is_hidden_is_not_judged(frames):
    frame = frames[0]
    hidden = np.zeros_like(frame.mask)
    hidden[300:400] = 1.0
    mask = frame.mask * (1.0 - hidden)
    covered = TestFrame(**{**vars(frame), "mask": mask, "hidden": hidden, "hands": ()})
    with judged() as judge:
        assert judge.figures(_picture(frame), covered)["body"]["psnr"] == 100.0


def test_flicker_is_a_multiple_of_the_films_own(frames):
    class Filmed:
        def __init__(self, share: float) -> None:
            self.share = share

        def render(self, _camera, pose):
            early, late = (_picture(frame) for frame in frames)
            return early + self.share * (late - early) * (pose.time_s == frames[1].pose.time_s)

    assert flicker(Filmed(1.0), *frames) == pytest.approx(1.0, abs=1e-5)  # type: ignore[arg-type]
    assert flicker(Filmed(0.0), *frames) == 0.0  # type: ignore[arg-type]
    assert flicker(Filmed(2.0), *frames) == pytest.approx(2.0, abs=1e-4)  # type: ignore[arg-type]
