"""Where tests find real footage, motion capture and metric weights: test data only."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_BESIDE_THE_REPOSITORY = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared_data(name: str) -> Path:
    """The file or folder `name` of the shared data, or skip the test that asks for it.

    The folder is `$METANERF_SHARED_DATA`, else `shared/data` beside the checkout.
    """
    folder = Path(os.environ.get("METANERF_SHARED_DATA", _BESIDE_THE_REPOSITORY))
    path = folder / name
    if not path.exists():
        pytest.skip(f"{path} is absent: set METANERF_SHARED_DATA to the folder with the test data")
    return path
