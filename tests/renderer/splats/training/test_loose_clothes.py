"""Trainings of people in loose clothes: cloth is found where there is any, learnt on, and goes on
from a checkpoint or an earlier model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from capture.storage import open_sequence
from capture.studio.sequence import make_sequence as make_studio_sequence
from renderer.evaluation.in_motion import rendered_in
from renderer.evaluation.metrics import psnr
from renderer.splats.cloth.fitting import find_cut
from renderer.splats.cloth.hanging import NO_CLOTH
from renderer.splats.layout import POSITION
from renderer.splats.model import SplatModel
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats
from renderer.splats.training.loose_clothes import ClipCloth, with_splats_on_cloth
from renderer.splats.training.trainer import SplatTrainer
from renderer.training import train
from scene.sequence import NOVEL_VIEW, Sequence, read_frame
from tests.renderer.clocks import ticking
from tests.renderer.splats.cloth.wear import make_loose_model, make_tubes
from tests.renderer.studio import make_sequence

SETTINGS = SplatSettings(count=300, most=300)


def trainer(start: SplatModel | None = None) -> SplatTrainer:
    return SplatTrainer(make_sequence(), SETTINGS, 0, start)


def studio(folder: Path, look: str) -> Sequence:
    make_studio_sequence(folder, seed=1, look=look, frames=12, size=80, test_cameras=1)
    return open_sequence(folder)


def test_tight_clothes_get_no_cloth_and_no_other_splats():
    tight = trainer()
    assert tight.model_so_far().cloth is None
    first = first_splats(make_sequence(), SETTINGS, np.random.default_rng(0))
    np.testing.assert_array_equal(tight.splats.first.parameters, first.parameters)
    assert (tight.splats.first.quads == NO_CLOTH).all()


def test_splats_on_cloth_are_as_dense_as_those_on_the_body():
    sequence, cloth = make_sequence(), make_tubes()
    first = first_splats(sequence, SETTINGS, np.random.default_rng(0))
    both = with_splats_on_cloth(first, cloth, sequence.body, SETTINGS, np.random.default_rng(1))
    on = both.quads != NO_CLOTH
    body_m2, cloth_m2 = 2 * (0.4 * 1.6 + 0.2 * 1.6 + 0.4 * 0.2), 2.0 * np.pi * (0.345 + 0.3) * 0.3
    assert abs(on.sum() / (~on).sum() / (cloth_m2 / body_m2) - 1.0) < 0.1
    quad = cloth.rest[cloth.quads[both.quads[on]]].mean(axis=1)
    away = np.linalg.norm(both.parameters[on, POSITION : POSITION + 3] - quad, axis=1)
    assert away.max() < 0.2
    np.testing.assert_array_equal(
        both.joints[on, 0], cloth.carriers[cloth.quads[both.quads[on], 0]]
    )


def test_cloth_of_an_earlier_model_is_learnt_on_and_goes_on_from_a_checkpoint():
    start = make_loose_model()
    one, other = trainer(start), trainer(start)
    on = one.splats.first.quads != NO_CLOTH
    before = one.splats.parameters.copy()
    for number in range(6):
        one.step(number / 12)
    assert np.abs(one.splats.parameters - before)[on].max() > 1e-3
    other.restore(one.state())
    for number in range(6, 12):
        one.step(number / 12)
        other.step(number / 12)
    np.testing.assert_array_equal(one.splats.parameters, other.splats.parameters)
    model = one.model_so_far()
    assert model.cloth is start.cloth
    assert (model.quads != NO_CLOTH).sum() == on.sum()


def test_other_cloth_takes_its_splats_along():
    sequence, cloth = make_sequence(), make_tubes()
    wide = trainer(make_loose_model())
    lower = replace(cloth, rest=cloth.rest + np.array([0.0, -0.05, 0.0]))
    worn = ClipCloth(lower, sequence.motion, sequence.body.skeleton)
    on = wide.splats.first.quads != NO_CLOTH
    before = wide.splats.parameters.copy()
    wide.splats.wear(worn)
    moved = (wide.splats.parameters - before)[:, POSITION + 1]
    np.testing.assert_allclose(moved[on], -0.05, atol=1e-5)
    np.testing.assert_array_equal(moved[~on], 0.0)
    assert wide.splats.cloth is lower


def test_a_studio_performers_loose_clothes_are_found_and_tight_ones_are_not(tmp_path):
    assert find_cut(studio(tmp_path / "plain", "plain")) is None
    loose = studio(tmp_path / "loose", "loose")
    model = train(loose, iterations=60, clock=ticking()).splats
    assert model is not None
    assert model.cloth is not None
    assert (model.quads != NO_CLOTH).mean() > 0.1
    bare = replace(
        model,
        parameters=np.where(
            model.quads[:, None] == NO_CLOTH, model.parameters, [0.0] * 13 + [-9.0]
        ),
        cloth=None,
    )
    found = []
    for shown in (model, bare):
        views = [read_frame(loose.test[NOVEL_VIEW], i) for i in range(0, 12, 3)]
        pictures = [rendered_in(shown, f.camera, f.pose, model.motion)[..., :3] for f in views]
        found.append(np.mean([psnr(p, f.image) for p, f in zip(pictures, views, strict=True)]))
    assert found[0] > found[1] + 2.0
