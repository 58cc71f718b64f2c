"""Parts of the body that were never filmed fade out, and sides of filmed ones stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.splats.layout import OPACITY
from renderer.splats.model import SplatModel
from scene import Pose, orbit_camera
from scene.arrays import Array, Float
from tests.renderer.studio import make_model


def filmed_at_a_desk() -> SplatModel:
    """The box person, whose lower half no frame showed."""
    model = make_model(1500)
    return replace(model, seen=model.parameters[:, 1] >= 0.8)


def opacity_shares(model: SplatModel) -> Float[Array, "N"]:
    """What is left of each splat's opacity where parts never filmed fade out."""
    before, after = (
        1.0 / (1.0 + np.exp(-m.parameters[:, OPACITY])) for m in (model, model.filmed_parts())
    )
    return after / before


def test_parts_never_filmed_fade_softly_with_the_distance_from_what_was():
    model = filmed_at_a_desk()
    share, below_m = opacity_shares(model), 0.8 - model.parameters[:, 1]
    assert share[below_m < 0.2].min() > 0.99
    assert share[below_m > 0.5].max() < 1e-3
    between = (share > 0.05) & (share < 0.95)
    assert between.sum() > 20  # a transition, no cut


def test_a_side_that_no_frame_showed_stays():
    model = make_model(1500)
    front = replace(model, seen=model.parameters[:, 2] >= -0.05)
    assert (~front.seen).sum() > 100
    assert opacity_shares(front).min() > 0.99


def test_the_faded_model_is_made_once_and_goes_with_its_model():
    model = filmed_at_a_desk()
    assert model.filmed_parts() is model.filmed_parts()
    whole = make_model(50)
    assert whole.filmed_parts() is whole


def test_nothing_filmed_leaves_nobody():
    model = make_model(200)
    alone = replace(model, seen=np.zeros(200, bool)).filmed_parts()
    camera = orbit_camera((0.0, 0.8, 0.0), 3.0, 0.0, 0.0, 32, 32)
    assert alone.render(camera, Pose.rest())[..., 3].max() < 1e-3


def test_the_filmed_half_stays_whole_and_the_invented_one_goes():
    model = filmed_at_a_desk()
    camera = orbit_camera((0.0, 0.8, 0.0), 3.0, 0.0, 0.0, 64, 64)
    faded, whole = (m.render(camera, Pose.rest())[..., 3] for m in (model.filmed_parts(), model))
    assert np.abs(faded[:30] - whole[:30]).mean() < 0.01
    assert faded[50:].sum() < 0.05 * whole[50:].sum()
