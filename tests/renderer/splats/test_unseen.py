"""Splats that no frame determines take their colour from those around them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.splats.layout import COLOUR, OPACITY, PARAMETERS
from renderer.splats.model import SplatModel
from renderer.splats.unseen import fill_unseen
from scene import Pose, orbit_camera
from scene.arrays import Array, Float
from tests.renderer.studio import make_model


def splats(*rows: tuple[float, float, float, float]) -> np.ndarray:
    """x, y, z and a shade of grey each."""
    parameters = np.zeros((len(rows), PARAMETERS), np.float32)
    for i, (x, y, z, grey) in enumerate(rows):
        parameters[i, :3], parameters[i, COLOUR : COLOUR + 3] = (x, y, z), grey
    return parameters


def line_of(*greys: float) -> np.ndarray:
    """Splats a centimetre apart, each of a shade of grey."""
    return splats(*((0.01 * i, 1.0, 0.0, grey) for i, grey in enumerate(greys)))


def test_determined_colours_stay_and_others_lie_between_them():
    trained = line_of(0.2, *[0.9] * 30, 0.8)
    evidence = np.zeros(32)
    evidence[[0, -1]] = 10.0
    filled = fill_unseen(trained, evidence)[:, COLOUR]
    np.testing.assert_allclose(filled[[0, -1]], [0.2, 0.8], atol=0.01)
    assert (np.diff(filled) > -1e-6).all()
    assert abs(filled[15:17].mean() - 0.5) < 0.02


def test_a_colour_that_frames_hardly_determine_gives_way_to_those_around():
    trained = line_of(*[0.4] * 10, 0.9, *[0.4] * 10)
    strong, weak = np.full(21, 5.0), np.full(21, 5.0)
    weak[10] = 0.02
    assert fill_unseen(trained, strong)[10, COLOUR] > 0.89
    assert fill_unseen(trained, weak)[10, COLOUR] < 0.45


def test_far_from_all_that_was_seen_the_mean_colour_holds():
    near, far = line_of(*[0.2] * 12), line_of(*[0.9] * 12)
    far[:, 0] += 5.0
    evidence = np.repeat([1.0, 0.0], 12)
    filled = fill_unseen(np.concatenate([near, far]), evidence)
    np.testing.assert_allclose(filled[:, COLOUR], 0.2, atol=1e-5)


def test_shape_and_opacity_stay():
    trained = np.random.default_rng(0).uniform(size=(40, PARAMETERS)).astype(np.float32)
    filled = fill_unseen(trained, np.linspace(0.0, 1.0, 40))
    rest = np.delete(np.arange(PARAMETERS), range(COLOUR, COLOUR + 3))
    np.testing.assert_array_equal(filled[:, rest], trained[:, rest])


def test_nothing_changes_where_nothing_was_seen():
    trained = line_of(0.1, 0.9)
    assert fill_unseen(trained, np.zeros(2)) is trained


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
