"""Real disks with little room."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from scene.errors import InvalidInput


class TinyDisk:
    """A disk in memory of a few bytes, mounted at a folder."""

    def __init__(self, folder: Path, size_bytes: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        if not shutil.which("mount") or self._mount(size_bytes):
            raise InvalidInput(
                "a tiny disk must be mounted by root; got another user; run as root, or leave it"
            )

    def _mount(self, size_bytes: int, *options: str) -> int:
        size = ",".join([f"size={size_bytes}", *options])
        command = ["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(self.folder)]
        return subprocess.run(command, capture_output=True).returncode

    def leave(self, room_bytes: int) -> None:
        """Take all room but so much."""
        self.resize(shutil.disk_usage(self.folder).used + room_bytes)

    def resize(self, size_bytes: int) -> None:
        """As when somebody frees space, or takes it."""
        assert self._mount(size_bytes, "remount") == 0

    def remove(self) -> None:
        """Unmount it; what lay on it is gone."""
        subprocess.run(["umount", "-l", str(self.folder)], check=True)
