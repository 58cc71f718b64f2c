"""What the version of commit c51c977 stored is still read: tests/stored/README.md."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture.storage import open_sequence
from renderer.model_files import load_model
from scene.motion import Motion
from scene.sequence import NOVEL_VIEW, Sequence

STORED = Path(__file__).parent / "stored"
VIEW, POSE = 2, 3
"""The test camera and the pose of the stored pictures."""


@pytest.fixture(scope="module")
def expected() -> dict[str, Any]:
    """What the code that wrote the files read from them."""
    return json.loads((STORED / "expected.json").read_text())


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("stored") / "sequence"
    with zipfile.ZipFile(STORED / "sequence.zip") as archive:
        archive.extractall(folder)
    return open_sequence(folder)


def assert_reads_as(motion: Motion, wanted: dict[str, Any]) -> None:
    for name, values in wanted.items():
        np.testing.assert_allclose(getattr(motion, name), values, atol=2e-6, err_msg=name)


def test_a_sequence_folder_is_read(sequence, expected):
    wanted = expected["sequence"]
    for name in ("person", "frames_per_second", "data_hash", "exact_poses"):
        assert getattr(sequence, name) == wanted[name], name
    assert_reads_as(sequence.motion, wanted["motion"])
    assert sequence.motion.expressions.any()
    joints = sequence.body.skeleton.rest_joints
    np.testing.assert_allclose(joints, wanted["rest_joints"], atol=2e-6)
    assert sequence.body.expression_directions is not None
    splits = {"train": sequence.train, **sequence.test}
    means = {
        name: [[split.image(i).mean(), split.mask(i).mean()] for i in range(len(split))]
        for name, split in splits.items()
    }
    assert set(means) == set(wanted["means"])
    for name, values in wanted["means"].items():
        np.testing.assert_allclose(means[name], values, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("kind", ["splats", "field"])
def test_a_model_draws_the_picture_that_it_drew(kind, sequence, expected):
    model = load_model(STORED / f"{kind}.safetensors")
    wanted = expected[kind]
    for name in ("preset", "data_hash", "metrics"):
        assert getattr(model, name) == wanted[name], name
    assert (model.kind, model.data_hash) == (kind, sequence.data_hash)
    assert_reads_as(model.motion, wanted["motion"])
    picture = model.render(sequence.test[NOVEL_VIEW].camera(VIEW), model.motion.pose(POSE))
    stored = cv2.imread(str(STORED / f"{kind}.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    drawn_then = cv2.cvtColor(stored, cv2.COLOR_BGRA2RGBA)
    assert (drawn_then[..., 3] > 128).mean() > 0.03
    difference = np.abs(255.0 * np.clip(picture, 0.0, 1.0) - drawn_then).max(axis=-1)
    assert (difference <= 2.0).mean() >= 0.999


def test_the_light_that_was_found_is_read():
    splats = load_model(STORED / "splats.safetensors").splats
    assert splats is not None
    assert splats.light is not None
    assert splats.albedo is not None
    assert splats.normals is not None
