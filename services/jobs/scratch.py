"""Folders for what is under way, and how those of dead processes are cleared."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_ABANDONED_S = 24 * 3600.0
"""Longer than any job or upload."""


@contextmanager
def scratch_folder(base: Path, name: str) -> Iterator[Path]:
    """An empty folder that is gone afterwards, whatever happens."""
    folder = base / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def clear_scratch(base: Path, name: str) -> None:
    """Remove the folder that a killed process left."""
    shutil.rmtree(base / name, ignore_errors=True)


def clear_abandoned(base: Path) -> None:
    """Remove what nobody has touched for a day."""
    if not base.is_dir():
        return
    for path in base.iterdir():
        try:
            old = time.time() - path.stat().st_mtime > _ABANDONED_S
        except FileNotFoundError:  # its owner has just removed it
            continue
        if old and path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        elif old:
            path.unlink(missing_ok=True)
