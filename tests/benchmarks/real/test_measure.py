"""A quick corner of `metanerf bench real`: one real clip, captured, trained for seconds, judged."""

from __future__ import annotations

import json

import cv2
import pytest

from benchmarks.real.cases import Case
from benchmarks.real.measure import Networks, measure
from tests.shared_data import shared_data

CASE = Case("quick", "patterned_shirt_eat", trained_share=0.8)


def networks() -> Networks:
    """Those of the shared data."""
    models = shared_data("models")
    return Networks(
        models / "pose_landmarker_full.task",
        models / "face_landmarker.task",
        models / "hand_landmarker.task",
        models / "alexnet_features.pth",
    )


@pytest.mark.usefixtures("fewer_steps")
def test_a_real_person_is_captured_trained_and_judged(tmp_path):
    footage = shared_data("real-webcam-people").parent
    sheet = tmp_path / "sheet.jpg"
    figures = measure(CASE, footage, networks(), 150, sheet)
    json.dumps(figures, allow_nan=False)
    assert figures["trained_frames"] == 37
    assert figures["clips"]["patterned_shirt_eat"]["frames"] == 47
    own, later = figures["as_given"]["own_views"], figures["as_given"]["later_frames"]
    assert own["frames"] + later["frames"] == 12
    # far below what a training of a minute reaches, far above what a wrong camera would
    assert own["body"]["psnr"] > 15.0
    assert own["body"]["iou"] > 0.85
    # eyes that were drawn at random would be off by a third of their width
    assert own["face"]["irises_percent"] < 15.0
    assert figures["aligned"]["later_frames"]["body"]["psnr"] >= later["body"]["psnr"] - 0.2
    drawn = cv2.imread(str(sheet))
    assert drawn is not None
    assert drawn.shape[0] > 600
