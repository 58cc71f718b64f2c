"""Where tests find real footage, motion capture and metric weights: test data only."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import pytest

_WITH_THE_TESTS = Path(__file__).resolve().parent / "data"
_BESIDE_THE_REPOSITORY = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared_data(name: str) -> Path:
    """The file or folder `name` of the test data, or skip the test that asks for it.

    What is small enough comes with the tests (tests/data); networks are looked for in
    `$METANERF_SHARED_DATA`, else in `shared/data` beside the checkout.
    """
    found = shared_file(name)
    if found is None:
        pytest.skip(f"{name} is absent: set METANERF_SHARED_DATA to the folder with the test data")
    return found


def shared_file(name: str) -> Path | None:
    """The file or folder `name` of the test data; None where it is absent."""
    elsewhere = Path(os.environ.get("METANERF_SHARED_DATA", _BESIDE_THE_REPOSITORY))
    # what comes with the tests goes first, so that they see the same everywhere
    folders = (_motions() if name.startswith("mocap") else _WITH_THE_TESTS, elsewhere)
    return next((path for folder in folders if (path := folder / name).exists()), None)


@cache
def _motions() -> Path:
    """The folder with `mocap/`, unpacked once for as long as the tests run."""
    folder = Path(tempfile.mkdtemp(prefix="metanerf-mocap-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    with zipfile.ZipFile(_WITH_THE_TESTS / "mocap.zip") as archive:
        archive.extractall(folder)
    return folder
