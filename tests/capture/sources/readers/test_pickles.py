"""Pickles of arrays come out whole; pickles of code do nothing and say so."""

from __future__ import annotations

import os
import pickle
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.errors import BrokenDataset
from capture.sources.readers.pickles import load_npy, load_pickle, numbers, strings, table

PLAIN = {
    "poses": np.arange(72.0, dtype=np.float32)[None],
    "big endian": np.arange(6, dtype=">i4").reshape(2, 3),
    "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "mask": np.array([True, False]),
    "names": np.array(["Camera_B1/000000.jpg", "b"]),
    "list": [np.eye(3), np.eye(3)],
    "scalar": np.float64(2.5),
    "text": "hello",
    "nested": {"a": (1, 2.5, None, True), "b": [b"bytes"]},
}


def written(path: Path, held: Any, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(held, protocol=protocol))
    return path


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_arrays_of_every_protocol_come_out(tmp_path, protocol):
    held = load_pickle(written(tmp_path / "a.pkl", PLAIN, protocol))
    np.testing.assert_array_equal(numbers(held["poses"], (72,), "poses"), PLAIN["poses"][0])
    for name in ("big endian", "fortran"):
        np.testing.assert_array_equal(numbers(held[name], (2, 3), name), PLAIN[name])
    np.testing.assert_array_equal(numbers(held["mask"], (2,), "mask"), [1.0, 0.0])
    np.testing.assert_array_equal(numbers(held["list"], (2, 3, 3), "list"), PLAIN["list"])
    assert strings(held["names"], "names") == ["Camera_B1/000000.jpg", "b"]
    assert (held["scalar"], held["text"], held["nested"]) == (2.5, "hello", PLAIN["nested"])


def test_numpy_before_its_second_version_is_read(tmp_path):
    """Its arrays name numpy.core, not numpy._core."""
    old = pickle.dumps(np.eye(3), protocol=3).replace(b"numpy._core", b"numpy.core")
    (tmp_path / "old.pkl").write_bytes(old)
    held = load_pickle(tmp_path / "old.pkl")
    np.testing.assert_array_equal(numbers(held, (3, 3), "K"), np.eye(3))


def test_npy_files_of_objects_and_of_numbers(tmp_path):
    np.save(tmp_path / "annots.npy", {"cams": {"K": [np.eye(3)]}}, allow_pickle=True)  # type: ignore
    np.save(tmp_path / "many.npy", np.array([{"a": 1}, {"a": 2}], dtype=object))
    np.save(tmp_path / "xyz.npy", np.arange(6.0).reshape(2, 3))
    held = table(load_npy(tmp_path / "annots.npy"), "annots.npy", "cams")
    np.testing.assert_array_equal(numbers(held["cams"]["K"], (1, 3, 3), "K"), [np.eye(3)])
    assert load_npy(tmp_path / "many.npy") == [{"a": 1}, {"a": 2}]
    np.testing.assert_array_equal(load_npy(tmp_path / "xyz.npy"), np.arange(6.0).reshape(2, 3))


class Evil:
    """Runs `call(*given)` when unpickled by Python's own pickle."""

    def __init__(self, call: Any, *given: Any) -> None:
        self._recipe = (call, given)

    def __reduce__(self) -> Any:
        return self._recipe


MALICIOUS = [
    ("os.system", Evil(os.system, "touch {flag}")),
    ("posix.system", Evil(os.system, "touch {flag}")),
    ("subprocess.Popen", Evil(subprocess.Popen, ["touch", "{flag}"])),
    ("builtins.eval", Evil(eval, "open('{flag}', 'w')")),
    ("builtins.getattr", Evil(getattr, "x", "upper")),
    ("pathlib", Path("x")),
    ("numpy.load", Evil(np.load, "x.npy")),
    ("numpy.fromfile", Evil(np.fromfile, "/etc/passwd")),
]


@pytest.mark.parametrize(("name", "evil"), MALICIOUS, ids=[name for name, _ in MALICIOUS])
@pytest.mark.parametrize("suffix", [".pkl", ".npy"])
def test_code_is_refused_and_never_run(tmp_path, name, evil, suffix):
    flag = tmp_path / "ran"
    path = tmp_path / f"evil{suffix}"
    if isinstance(evil, Evil):
        call, given = evil.__reduce__()
        evil = Evil(
            call, *(one.format(flag=flag) if isinstance(one, str) else one for one in given)
        )
    if suffix == ".npy":
        np.save(path, np.array([{"poses": evil}], dtype=object))
        load = load_npy
    else:
        written(path, {"poses": np.eye(2), "Rh": evil})
        load = load_pickle
    with pytest.raises(
        BrokenDataset, match=rf"^evil\{suffix} must hold only arrays, dicts.*call of"
    ):
        load(path)
    assert not flag.exists()


def crafted(array: bytes) -> bytes:
    """A pickle (protocol 2) whose array is rebuilt from `array`: shape, dtype, order, data."""
    return (
        b"\x80\x02cnumpy._core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R("
        + array
        + b"tb."
    )


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "must be a whole pickle"),
        (b"not a pickle", "must be a whole pickle"),
        (pickle.dumps(PLAIN)[:-9], "must be a whole pickle"),
        # a shape of 10^9 numbers with eight bytes of data
        (
            crafted(b"K\x01J\x00\xca\x9a\x3b\x85cnumpy\ndtype\nU\x02f8\x85R\x89U\x08" + b"\0" * 8),
            "must fill it; got 8 bytes",
        ),
        # a dtype of Python pointers filled from bytes
        (
            crafted(b"K\x01K\x01\x85cnumpy\ndtype\nU\x02O8\x85R\x89U\x08" + b"\1" * 8),
            "must fill it",
        ),
        # a structured dtype
        (
            crafted(b"K\x01K\x01\x85cnumpy\ndtype\nU\x02V8\x85R\x89U\x08" + b"\0" * 8),
            "arrays must be of numbers or strings; got 'V8'",
        ),
        # codecs that inflate
        (
            b"\x80\x02c_codecs\nencode\nX\x01\x00\x00\x00aX\x04\x00\x00\x00zlib\x86R.",
            "bytes must be written as latin1; got 'zlib'",
        ),
        # state pushed into an allowed function
        (b"\x80\x02cnumpy\ndtype\n}X\x01\x00\x00\x00aK\x01sb.", "a function can't be changed"),
    ],
)
def test_broken_and_crafted_files_are_refused(tmp_path, data, message):
    (tmp_path / "a.pkl").write_bytes(data)
    with pytest.raises(BrokenDataset, match=message):
        load_pickle(tmp_path / "a.pkl")


def test_a_missing_file_and_a_broken_npy_are_named(tmp_path):
    with pytest.raises(BrokenDataset, match=r"gone\.pkl must be a readable file"):
        load_pickle(tmp_path / "gone.pkl")
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(BrokenDataset, match=r"a\.npy must be a readable \.npy file"):
        load_npy(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("value", "shape", "message"),
    [
        (np.zeros(71), (72,), "poses must be 72; got 71"),
        (np.zeros((3, 24)), (24, 3), "poses must be 24 x 3; got 3 x 24"),
        (np.array([np.nan]), (1,), "poses must be finite"),
        ("text", (1,), "poses must be numbers"),
        ({}, (1,), "poses must be numbers"),
        (np.zeros(4), (None, 3), "poses must be N x 3; got 4"),
    ],
)
def test_numbers_of_the_wrong_kind_are_named(value, shape, message):
    with pytest.raises(BrokenDataset, match=message):
        numbers(value, shape, "poses")


def test_tables_and_names_of_the_wrong_kind_are_named():
    with pytest.raises(BrokenDataset, match="cams must hold K, R; R is missing"):
        table({"K": 1}, "cams", "K", "R")
    with pytest.raises(BrokenDataset, match="cams must be a dict; got list"):
        table([], "cams")
    with pytest.raises(BrokenDataset, match="ims must be a list of names; got list"):
        strings([1, 2], "ims")
