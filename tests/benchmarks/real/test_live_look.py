"""A quick corner of `metanerf bench live-look`: a clip that plays to the model made of it."""

from __future__ import annotations

import json

import cv2
import pytest

from benchmarks.real.cases import Case
from benchmarks.real.live_look import measure
from tests.benchmarks.real.test_measure import networks
from tests.shared_data import shared_data

CLIP = "patterned_shirt_eat"


@pytest.mark.usefixtures("fewer_steps")
def test_live_look_comes_nearer_to_the_frames_than_the_model(tmp_path):
    footage, sheet = shared_data("real-webcam-people").parent, tmp_path / "sheet.jpg"
    case = Case("quick", CLIP, other_clips=(CLIP,))
    figures = measure(case, footage, networks(), 150, sheet)
    json.dumps(figures, allow_nan=False)
    model, live = figures["webcam"]["model"], figures["webcam"]["live"]
    assert model["frames"] == live["frames"] == 12
    for part in ("body", "face", "hands"):
        assert live[part]["lpips"] < 0.95 * model[part]["lpips"], part
        assert live[part]["psnr"] > model[part]["psnr"] + 0.5, part
    assert "other_cameras" not in figures
    drawn = cv2.imread(str(sheet))
    assert drawn is not None
    assert drawn.shape[0] > 5 * 300
