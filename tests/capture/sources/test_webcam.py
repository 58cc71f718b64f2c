"""Webcams: a clip file stands in for the device, since OpenCV opens both alike."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import capture.sources.webcam
from capture.errors import CaptureStopped
from capture.overlay import write_video
from capture.sources.video import read_video
from capture.sources.webcam import record_webcam


@pytest.fixture
def device(tmp_path, monkeypatch):
    """A webcam that shows 40 grey frames and is then unplugged."""
    path = tmp_path / "device.mp4"
    write_video([np.full((48, 64, 3), 5 * i, dtype=np.uint8) for i in range(40)], path, 30)
    real = cv2.VideoCapture
    monkeypatch.setattr(capture.sources.webcam.cv2, "VideoCapture", lambda index: real(str(path)))


class Clock:
    """Moves a thirtieth of a second whenever it is read."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 1.0 / 30.0
        return self.now


def test_it_films_for_the_time_asked(device, tmp_path):
    path = record_webcam(0, 0.5, folder=tmp_path, clock=Clock())
    clip = read_video(path)
    assert len(clip.images) == pytest.approx(15, abs=1)
    assert clip.frames_per_second == pytest.approx(30.0, rel=0.15)
    assert clip.images[0].shape == (48, 64, 3)


def test_a_webcam_that_goes_away_keeps_what_was_filmed(device, tmp_path):
    clip = read_video(record_webcam(0, 60.0, folder=tmp_path, clock=Clock()))
    assert len(clip.images) == 40


def test_stopping_early_keeps_what_was_filmed(device, tmp_path):
    asked = iter([False] * 10 + [True] * 100)
    path = record_webcam(0, 60.0, lambda: next(asked), folder=tmp_path, clock=Clock())
    assert len(read_video(path).images) == 10


def test_stopping_before_the_first_picture_is_a_stop(device, tmp_path):
    with pytest.raises(CaptureStopped):
        record_webcam(0, 60.0, lambda: True, folder=tmp_path, clock=Clock())
