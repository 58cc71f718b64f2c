"""The landmark finder's own time, from a real page whose camera shows a real person."""

from __future__ import annotations

from pathlib import Path

import av
import pytest

from benchmarks.landmark_finder import CAMERA, measured, write_webcam_video
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
CLIP = "real-monocular/webcam_upperbody_woman_asl.mp4"


def test_a_clip_becomes_the_film_of_a_camera(tmp_path: Path):
    made = write_webcam_video(shared_data(CLIP), tmp_path / "webcam.mjpeg", 70, 75)
    with av.open(str(made)) as camera:
        frames = list(camera.decode(video=0))
    assert [(frame.width, frame.height) for frame in frames] == 5 * [CAMERA]


def test_the_worker_tells_its_time_for_each_picture(pose_model: Path):
    figures = measured(shared_data(CLIP), pose_model, watched_s=4.0)
    assert figures["pictures"] >= 4
    assert 0.0 < figures["p50_ms"] <= figures["p95_ms"] < 4000.0
    # one picture at a time: together they take no longer than was watched
    assert figures["pictures"] * figures["p50_ms"] < 2.0 * 4000.0
