"""Folders for what is under way; those of dead processes are cleared.

A folder's name says whose it is: `HOST@PID@random`.
"""

from __future__ import annotations

import os
import shutil
import socket
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from db.objects import naming_errors

_ABANDONED_S = 24 * 3600.0
"""Longer than any job or upload; for folders of other hosts, whose processes can't be asked."""


@contextmanager
def scratch_folder(base: Path) -> Iterator[Path]:
    """An empty folder that is gone afterwards, whatever happens. Raises StoreFull."""
    folder = base / f"{socket.gethostname()}@{os.getpid()}@{uuid.uuid4().hex}"
    with naming_errors():
        folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def clear_abandoned(base: Path) -> None:
    """Remove folders whose process is gone, or that nobody has touched for a day."""
    for folder in base.iterdir() if base.is_dir() else ():
        if _is_abandoned(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _is_abandoned(folder: Path) -> bool:
    try:
        if time.time() - folder.stat().st_mtime > _ABANDONED_S:
            return True
    except FileNotFoundError:  # its owner has just removed it
        return False
    host, _, rest = folder.name.partition("@")
    pid = rest.partition("@")[0]
    return host == socket.gethostname() and pid.isdigit() and not _is_alive(int(pid))


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
