"""The process that looks at one upload: `python -m services.uploads.confined PATH NAME`.

Decoders of video and pictures are C code, and a hostile file may crash them, fill the memory, never
end, or run its own code. So they run here, with little memory and time, few files, no network where
the system lets a process give it up, and nothing secret in the environment. One line of JSON on
standard output says what was found (`kind`), or why it is refused (`refused`, `error`), or that the
disk is full (`errno`).
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import sys
from contextlib import suppress
from pathlib import Path

MEMORY_BYTES = 3 << 30
"""Of addresses: a frame of 8K takes a tenth of a gigabyte, libraries half of one."""
PROCESSOR_S = 60
_OPEN_FILES = 64
_LEAST_FILE_BYTES = 64 << 20
_UNPACKED = 4
"""How much larger than the upload a file may be that is unpacked from it."""
_NEW_USER, _NEW_NETWORK = 0x10000000, 0x40000000
"""CLONE_NEWUSER and CLONE_NEWNET of unshare(2)."""


def main(path: Path, name: str) -> None:
    """Look at `path` and print what was found."""
    confine(path.stat().st_size)
    from db.objects import no_space
    from scene.errors import SceneError
    from services.uploads.check import check_upload

    try:
        found: dict[str, object] = {"kind": check_upload(path, name).kind}
    except SceneError as error:
        found = {"refused": str(error), "error": type(error).__name__}
    except OSError as error:
        if not no_space(error):
            raise
        found = {"errno": error.errno}
    print(json.dumps(found))


def confine(upload_bytes: int) -> None:
    """Limit this process for good."""
    _leave_network()
    largest = max(_LEAST_FILE_BYTES, _UNPACKED * upload_bytes)
    for kind, limit in (
        (resource.RLIMIT_AS, MEMORY_BYTES),
        (resource.RLIMIT_CPU, PROCESSOR_S),
        (resource.RLIMIT_FSIZE, largest),
        (resource.RLIMIT_NOFILE, _OPEN_FILES),
        (resource.RLIMIT_CORE, 0),
    ):
        _, most = resource.getrlimit(kind)
        limit = limit if most == resource.RLIM_INFINITY else min(limit, most)
        with suppress(ValueError, OSError):  # macOS takes no limit of addresses
            resource.setrlimit(kind, (limit, limit))


def _leave_network() -> None:
    """Go where there is no network; stay where the system does not let this process go."""
    unshare = getattr(ctypes.CDLL(None, use_errno=True), "unshare", None)
    if unshare is None or unshare(_NEW_NETWORK) == 0:
        return
    user, group = os.getuid(), os.getgid()
    if unshare(_NEW_USER | _NEW_NETWORK) == 0:
        with suppress(OSError):  # without its own number in there, it can make no files
            Path("/proc/self/setgroups").write_text("deny")
            Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
            Path("/proc/self/gid_map").write_text(f"{group} {group} 1")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
