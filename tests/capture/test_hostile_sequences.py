"""Folders that a captured clip left are read or refused, whatever is in them."""

from __future__ import annotations

import json
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.errors import BrokenSequence
from capture.storage import open_sequence, read_quality
from scene.errors import SceneError
from scene.sequence import read_frame
from tests.capture.sequences import write_small
from tests.few_examples import FEW, damaged

pytestmark = pytest.mark.usefixtures("unchecked_annotations")

ARRAYS = {
    "cameras.npz": ("intrinsics", "world_to_camera", "size", "distortion"),
    "motion.npz": ("times_s", "joint_angles", "root_translation", "confidence", "expressions"),
    "body.npz": ("rest_joints", "rest_vertices", "faces", "blend_weights", "expression_directions"),
}
VALUES = [
    np.array(3.0),
    np.zeros(0),
    np.zeros((0, 3, 3)),
    np.full((3, 2), np.inf),
    np.full((3, 2), np.nan),
    np.full((3, 2), -1.0),
    np.full((3, 2), 2**62),
    np.full((3, 3, 3), 1e308),
    np.full((3, 24, 3), np.nan),
    np.zeros((24, 3)),
    np.zeros((3, 15)),
    np.zeros((3, 99)),
    np.zeros((1, 1, 1, 1, 1)),
    np.array(["words", "of", "somebody"]),
    np.array([b"bytes"] * 3),
    np.array([1j, 2j, 3j]),
    np.array([True, False, True]),
    np.zeros(3, [("a", float), ("b", int)]),
    np.zeros(3, "M8[s]"),
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small(tmp_path_factory.mktemp("whole") / "seq", surface=True)


def _read_all(folder: Path) -> None:
    """As a training does; only errors of ours may be raised."""
    with suppress(SceneError):
        sequence = open_sequence(folder)
        for source in (sequence.train, *sequence.test.values()):
            for index in range(len(source)):
                read_frame(source, index)
    with suppress(SceneError):
        read_quality(folder)


def _with(whole: Path, change: Callable[[Path], object]) -> None:
    with tempfile.TemporaryDirectory() as at:
        folder = Path(at) / "seq"
        shutil.copytree(whole, folder)
        change(folder)
        _read_all(folder)


def test_files_of_any_bytes(whole: Path):
    names = sorted(str(one.relative_to(whole)) for one in whole.rglob("*") if one.is_file())
    assert len(names) > 8

    @FEW
    @given(
        change=st.sampled_from(names).flatmap(
            lambda name: st.tuples(st.just(name), damaged((whole / name).read_bytes()))
        )
    )
    def attack(change: tuple[str, bytes]) -> None:
        name, data = change
        _with(whole, lambda folder: (folder / name).write_bytes(data))

    attack()


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("value", VALUES, ids=lambda value: f"{value.dtype.kind}{value.shape}")
def test_arrays_of_anything(whole: Path, name: str, value: np.ndarray):
    for key in ARRAYS[name]:

        def change(folder: Path, key: str = key) -> None:
            with np.load(folder / name) as stored:
                arrays: dict[str, Any] = dict(stored)
            arrays[key] = value
            np.savez(folder / name, **arrays)

        _with(whole, change)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=6,
)


def test_words_of_anything(whole: Path):
    about = json.loads((whole / "sequence.json").read_text())

    @FEW
    @given(field=st.sampled_from(sorted(about)), value=_JSON)
    def attack(field: str, value: object) -> None:
        told = json.dumps(about | {field: value})
        _with(whole, lambda folder: (folder / "sequence.json").write_text(told))

    attack()


def test_arrays_that_inflate_beyond_all_measure_are_refused_unread(whole: Path, tmp_path: Path):
    shutil.copytree(whole, tmp_path / "seq")
    header = b"\x93NUMPY\x01\x00v\x00"
    header += (
        b"{'descr': '|u1', 'fortran_order': False, 'shape': (629145600,), }".ljust(117) + b"\n"
    )
    with (
        zipfile.ZipFile(tmp_path / "seq/motion.npz", "w", zipfile.ZIP_DEFLATED) as file,
        file.open("times_s.npy", "w", force_zip64=True) as array,
    ):
        array.write(header)
        for _ in range(600):
            array.write(bytes(1 << 20))
    assert (tmp_path / "seq/motion.npz").stat().st_size < 1 << 20
    with pytest.raises(BrokenSequence, match=r"motion\.npz .* got 600 MiB, of 512 at most"):
        open_sequence(tmp_path / "seq")


def test_an_array_in_place_of_several_is_refused(whole: Path, tmp_path: Path):
    shutil.copytree(whole, tmp_path / "seq")
    with (tmp_path / "seq/motion.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(BrokenSequence, match=r"motion\.npz must be a readable \.npz file"):
        open_sequence(tmp_path / "seq")


@pytest.mark.parametrize("text", ["[" * 200_000, '{"version":' * 100_000])
def test_words_nested_without_end_are_refused(whole: Path, tmp_path: Path, text: str):
    folder = tmp_path / "seq"
    shutil.copytree(whole, folder)
    (folder / "sequence.json").write_text(text)
    with pytest.raises(BrokenSequence, match=r"with a sequence\.json; got"):
        open_sequence(folder)
