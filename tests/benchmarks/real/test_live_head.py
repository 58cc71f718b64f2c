"""Heads that turn by known angles are measured as such, and a real head as a page sees it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.real.live_head import errors_deg, measured
from capture.detection.face_and_hands import FaceAndHandDetector
from capture.detection.landmarks import MediaPipeEstimator
from scene.rotations import axis_angle_to_matrix
from tests.shared_data import shared_data


def test_angles_and_unsteadiness_are_those_that_were_made():
    turns = np.radians([0.0, 1.0, 2.0, 3.0, 6.0])
    heads = axis_angle_to_matrix(np.outer(turns, [0.0, 1.0, 0.0]))
    off = axis_angle_to_matrix(np.radians([[0.0, 0.0, 4.0]]))
    found = errors_deg(list(heads @ off), list(heads))
    assert found == pytest.approx({"mean": 4.0, "p95": 4.0, "unsteady": 0.67}, abs=0.02)


def test_a_real_head_is_where_its_face_has_it(
    pose_model: Path, face_model: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("benchmarks.real.live_head.FRAMES", 40)
    clip = shared_data("real-webcam-people/grey_shirt_sorry.mkv")
    with (
        MediaPipeEstimator(pose_model, people=1) as bodies,
        FaceAndHandDetector(face_model, None) as faces,
    ):
        found = measured(clip, bodies, faces)
    assert found["pictures"] > 30
    assert found["followed"]["mean"] < 0.5 * found["solved"]["mean"]
    assert found["followed"]["p95"] < 8.0
