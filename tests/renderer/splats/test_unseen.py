"""Splats that no frame determines take their colour from those around them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.splats.layout import COLOUR, OPACITY, PARAMETERS
from renderer.splats.model import SplatModel
from renderer.splats.unseen import fill_unseen
from scene import Pose, orbit_camera
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


def filmed_from_the_front() -> SplatModel:
    """The box person, whose back (z < 0) no frame showed."""
    model = make_model(1500)
    return replace(model, seen=model.parameters[:, 2] >= -0.05)


def test_only_what_was_filmed_stays_and_fades_softly():
    model = filmed_from_the_front()
    alone = model.captured_only()
    before, after = (1.0 / (1.0 + np.exp(-m.parameters[:, OPACITY])) for m in (model, alone))
    share = after / before
    np.testing.assert_allclose(share[model.seen], 1.0, atol=1e-5)
    z = model.parameters[:, 2]
    x, y = model.parameters[:, 0], model.parameters[:, 1]
    back = (z < -0.099) & (np.abs(x) < 0.1) & (np.abs(y - 0.8) < 0.6)  # a hand from what was seen
    assert back.sum() > 50
    assert share[back].max() < 1e-3
    between = (share > 0.05) & (share < 0.95)
    assert between.sum() > 20  # a transition, no cut


def test_a_lone_unseen_splat_leaves_no_hole():
    model = make_model(3000)
    seen = np.ones(len(model), bool)
    seen[::50] = False
    alone = replace(model, seen=seen).captured_only()
    before, after = (1.0 / (1.0 + np.exp(-m.parameters[:, OPACITY])) for m in (model, alone))
    assert (after / before).min() > 0.85


def test_the_faded_model_is_made_once_and_goes_with_its_model():
    model = filmed_from_the_front()
    assert model.captured_only() is model.captured_only()
    whole = make_model(50)
    assert whole.captured_only() is whole


def test_nothing_filmed_leaves_nobody():
    model = make_model(200)
    alone = replace(model, seen=np.zeros(200, bool)).captured_only()
    camera = orbit_camera((0.0, 0.8, 0.0), 3.0, 0.0, 0.0, 32, 32)
    assert alone.render(camera, Pose.rest())[..., 3].max() < 1e-3


def test_the_front_stays_whole_and_the_guessed_back_goes():
    """The box is blue at the back alone; from behind, its front is seen from within."""
    model = filmed_from_the_front()
    front, back = (
        [
            m.render(orbit_camera((0.0, 0.8, 0.0), 3.0, azimuth, 0.0, 64, 64), Pose.rest()).copy()
            for m in (model.captured_only(), model)
        ]
        for azimuth in (0.0, np.pi)
    )
    assert np.abs(front[0] - front[1]).mean() < 0.03
    assert back[0][24:40, 30:34, 2].mean() < 0.05 < 0.9 < back[1][24:40, 30:34, 2].mean()
