"""The model as others see it: pictures, and files that give the same pictures back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import BrokenModel
from renderer.field.model import FieldModel
from renderer.field.sizes import MlpSize
from renderer.field.training.trainer import FieldTrainer
from renderer.model_files import load_model, save_model
from renderer.performer_model import PerformerModel
from renderer.presets import Preset, find_preset
from scene import look_at
from scene.camera import Camera
from scene.errors import InvalidInput
from tests.renderer.field.performer import TINY, pose, sequence, view


@pytest.fixture(scope="module")
def model() -> FieldModel:
    trainer = FieldTrainer(sequence(), "fast", TINY, 0)
    for step in range(5):
        trainer.step(step / 5.0)
    return trainer.finish({"steps": 5})


def test_is_a_person_model(model):
    assert isinstance(model, PerformerModel)
    assert model.data_hash == sequence().data_hash
    assert len(model.motion) == len(sequence().motion)


def test_it_is_drawn_with_a_fields_speed_ups_alone(model):
    own = model.field.sizes
    drawn = model.drawn_as(
        Preset("fast", "without a posed grid", replace(TINY, sizes=replace(own, posed_grid=0)))
    )
    assert drawn.field.sizes.posed_grid == 0
    assert model.field.sizes is own
    with pytest.raises(InvalidInput, match="must be a field's; got 'splats'"):
        model.drawn_as(find_preset("splats"))


def test_pictures_are_premultiplied_and_in_range(model):
    picture = model.render(view(0.7, 40), pose(0.2))
    assert picture.shape == (40, 40, 4)
    assert picture.dtype == np.float32
    assert picture.min() >= 0.0
    assert picture.max() <= 1.0 + 1e-4
    assert (picture[..., :3] <= picture[..., 3:] + 1e-4).all()
    assert picture[..., 3].max() > 0.9


def test_the_picture_follows_the_body(model):
    moment = pose(0.0)
    moved = replace(moment, root_translation=np.array([0.5, 0.0, 0.0]))
    columns = [
        np.flatnonzero(model.render(view(0.0, 40), p)[..., 3].any(axis=0)).mean()
        for p in (moment, moved)
    ]
    assert columns[1] > columns[0] + 3.0


@pytest.mark.parametrize("target", [(0.0, 0.9, 9.0), (9.0, 0.9, 4.0)])
def test_a_camera_that_looks_away_sees_nothing(model, target):
    camera = Camera.from_field_of_view(look_at((0.0, 0.9, 4.0), target), 32, 24, 0.6)
    assert (model.render(camera, pose(0.0)) == 0.0).all()


def test_a_camera_inside_the_body_does_not_fall_over(model):
    camera = Camera.from_field_of_view(look_at((0.0, 1.1, 0.0), (0.0, 1.1, 1.0)), 16, 16, 0.6)
    assert np.isfinite(model.render(camera, pose(0.0))).all()


def test_a_file_gives_the_same_pictures_back(model, tmp_path):
    path = tmp_path / "model.safetensors"
    save_model(model, path)
    again = load_model(path)
    assert isinstance(again, FieldModel)
    assert again.field.sizes == model.field.sizes
    assert again.metrics == {"steps": 5}
    camera, moment = view(0.4, 40), pose(0.1, 0.5)
    assert np.allclose(again.render(camera, moment), model.render(camera, moment), atol=2e-3)


def test_a_file_with_a_part_missing_is_refused(model, tmp_path):
    class Torn(FieldModel):
        def tensors(self) -> dict[str, np.ndarray]:
            kept = dict(super().tensors())
            del kept["field.canonical.table"]
            return kept

    torn = Torn(model.field, preset="fast", motion=model.motion, data_hash="0", metrics={})
    save_model(torn, tmp_path / "torn.safetensors")
    with pytest.raises(BrokenModel, match=r"learnt tensors must be .*canonical\.table"):
        load_model(tmp_path / "torn.safetensors")


def test_a_field_with_every_network_survives_the_file(tmp_path):
    sizes = replace(
        TINY.sizes,
        grid=None,
        octaves=4,
        colour=MlpSize(2, 16, skip=2),
        latent=8,
        latent_channels=16,
        volume=(16, 16, 16),
        residual=MlpSize(2, 16),
        posed_grid=0,
        inverse_rounds=0,
        step_m=0.1,
    )
    trainer = FieldTrainer(sequence(), "fast", replace(TINY, sizes=sizes, rays_a_frame=16), 0)
    trainer.step(0.5)
    model = trainer.finish({})
    save_model(model, tmp_path / "all.safetensors")
    again = load_model(tmp_path / "all.safetensors")
    camera, moment = view(0.4, 8), pose(0.1, 0.5)
    assert np.allclose(again.render(camera, moment), model.render(camera, moment), atol=1e-2)
