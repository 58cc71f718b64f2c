"""Models lose what the bits of their numbers are too few for, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.precision import PRECISIONS, stored_in
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.motion import Pose
from tests.renderer.studio import make_sequence


@pytest.fixture(scope="module", params=["splats", "fast"])
def model(request: pytest.FixtureRequest) -> PerformerModel:
    return train(make_sequence(), preset=request.param, iterations=60, clock=float)


def test_fewer_bits_lose_more_of_the_picture(model: PerformerModel):
    camera = make_sequence().train.camera(0)
    drawn = model.render(camera, Pose.rest()).copy()
    assert drawn[..., 3].max() > 0.5  # else nothing is tested
    half, brain = (
        np.abs(stored_in(model, precision).render(camera, Pose.rest()) - drawn).mean()
        for precision in PRECISIONS[1:]
    )
    assert 0.0 < half < 0.5 * brain < 0.02


def test_the_motion_is_left_as_it_is(model: PerformerModel):
    low = stored_in(model, "bfloat16").motion
    np.testing.assert_allclose(low.joint_angles, model.motion.joint_angles, atol=1e-6)
    np.testing.assert_array_equal(low.times_s, model.motion.times_s)
