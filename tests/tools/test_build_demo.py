"""The demo's performer as it is handed out."""

from __future__ import annotations

import pytest

from renderer.model_files import load_model
from renderer.splats.model import SplatModel
from services.bootstrap import DEMO_MODEL
from services.live.room import facing_yaw


def test_the_performer_faces_the_camera_that_filmed_their_light():
    model = load_model(DEMO_MODEL)
    assert isinstance(model, SplatModel)
    assert model.light is not None
    assert facing_yaw(model.motion) == pytest.approx(0.0, abs=1e-3)
    mean = model.motion.root_translation.mean(axis=0)
    assert mean[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-3)
