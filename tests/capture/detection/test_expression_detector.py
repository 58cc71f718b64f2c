"""Faces and hands found in pictures of a studio performer, against what they did."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture.detection.expression_detector import ExpressionDetector, clip_expressions
from capture.detection.landmarks import Landmarks, MediaPipeEstimator
from capture.errors import PoseModelMissing
from capture.storage import open_sequence
from capture.studio import make_sequence
from scene.arrays import Array, UInt8
from scene.expression import EXPRESSION_NAMES
from scene.sequence import Sequence

FRAMES = 24
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


def test_a_mouth_is_seen_to_open_as_it_did(filmed, pictures, people, face_model, hand_model):
    with closing(ExpressionDetector(face_model, hand_model)) as finder:
        shown = clip_expressions(pictures, people, finder)
    truth = filmed.motion.expressions[:FRAMES]
    assert np.ptp(truth[:, JAW]) > 0.5  # else nothing is tested
    assert np.corrcoef(shown[:, JAW], truth[:, JAW])[0, 1] > 0.95
    assert np.abs(shown[:, JAW] - truth[:, JAW]).mean() < 0.1
    assert ((shown >= 0.0) & (shown <= 1.0)).all()


def test_who_is_lost_or_hidden_is_at_rest(pictures, people, face_model, hand_model):
    first = next(one for one in people if one is not None)
    away = replace(first, visibility=np.zeros(33), pixels=first.pixels + 4000.0)
    with closing(ExpressionDetector(face_model, hand_model)) as finder:
        assert not clip_expressions(pictures[:2], [None, away], finder).any()
        assert finder.hand(pictures[0], away, "left_hand") is None


def test_without_models_nothing_is_known(pictures, people):
    with closing(ExpressionDetector(None, None)) as finder:
        assert not clip_expressions(pictures[:3], people[:3], finder).any()


def test_a_file_that_is_no_model_is_refused_by_name(tmp_path: Path):
    path = tmp_path / "face.task"
    path.write_bytes(b"none")
    with pytest.raises(PoseModelMissing, match=r"MediaPipe \.task file; got .*face\.task"):
        ExpressionDetector(path, None)
