"""Model files: nothing is lost, and what is no model says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import BrokenModel
from renderer.model_files import load_model, save_model
from renderer.performer_model import PerformerModel
from renderer.splats.files.ply import write_ply
from renderer.splats.model import SplatModel
from tests.renderer.studio import SIZE, make_model, make_sequence


def test_a_model_round_trips(tmp_path):
    model, path = make_model(), tmp_path / "person.safetensors"
    save_model(model, path)
    loaded = load_model(path)
    assert isinstance(loaded, SplatModel)
    assert isinstance(loaded, PerformerModel)
    np.testing.assert_array_equal(loaded.parameters[:, :3], model.parameters[:, :3])
    np.testing.assert_allclose(loaded.parameters, model.parameters, atol=4e-3)
    np.testing.assert_allclose(loaded.motion.joint_angles, model.motion.joint_angles, atol=1e-6)
    assert (loaded.preset, loaded.data_hash) == ("splats", "of a test")
    assert [p.name for p in tmp_path.iterdir()] == ["person.safetensors"]


def test_the_light_is_kept_where_it_is_known(tmp_path):
    light = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32)
    surface = np.full((600, 3), 0.5, np.float32)
    model, path = make_model(), tmp_path / "person.safetensors"
    save_model(replace(model, albedo=surface, normals=surface, light=light), path)
    loaded = load_model(path)
    assert isinstance(loaded, SplatModel)
    assert loaded.light is not None
    np.testing.assert_array_equal(loaded.light, light)
    save_model(model, path)
    without = load_model(path)
    assert isinstance(without, SplatModel)
    assert without.light is None


def test_it_renders_the_same_picture(tmp_path):
    model, path = make_model(), tmp_path / "person.safetensors"
    save_model(model, path)
    camera, pose = make_sequence().train.camera(0), model.motion.pose(1)
    before, after = model.render(camera, pose), load_model(path).render(camera, pose)
    assert before.shape == (SIZE, SIZE, 4)
    assert np.abs(before - after).max() < 0.01


def test_truncated_files_are_refused(tmp_path):
    path = tmp_path / "person.safetensors"
    save_model(make_model(50), path)
    data = path.read_bytes()
    for length in (0, 7, 100, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:length])
        with pytest.raises(BrokenModel, match="must be a model file"):
            load_model(path)


def test_a_missing_file_and_a_foreign_one_are_refused(tmp_path):
    with pytest.raises(BrokenModel, match="must be a model file"):
        load_model(tmp_path / "nothing.safetensors")
    from safetensors.numpy import save_file

    save_file({"weights": np.zeros(3)}, str(tmp_path / "other.safetensors"))
    with pytest.raises(BrokenModel, match="must be a model of version 1; got None"):
        load_model(tmp_path / "other.safetensors")


def test_ply_holds_every_splat(tmp_path):
    write_ply(make_model(50), tmp_path / "splats.ply")
    data = (tmp_path / "splats.ply").read_bytes()
    header, rows = data.split(b"end_header\n")
    assert b"element vertex 50" in header
    assert len(rows) == 50 * 14 * 4
    np.testing.assert_allclose(
        np.frombuffer(rows, "<f4").reshape(50, 14)[:, :3], make_model(50).parameters[:, :3]
    )
