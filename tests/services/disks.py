"""Real disks with little room, for tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.faults import disks
from scene.errors import InvalidInput


def tiny_disk(folder: Path, size_bytes: int) -> disks.TinyDisk:
    """A disk in memory of so many bytes; skips where none can be mounted."""
    try:
        return disks.TinyDisk(folder, size_bytes)
    except InvalidInput as error:
        pytest.skip(str(error))
