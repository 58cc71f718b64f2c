"""How a process gives up what it does not need before it reads a stranger's file.

Decoders of video and pictures are C code, and a hostile file may crash them, fill the memory, never
end, or run its own code. So they run in processes of their own, with bounded memory, time and
files, no network where the system lets a process give it up, and nothing secret in the environment.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_PASSED_ON = ("PATH", "TMPDIR", "LANG", "LD_LIBRARY_PATH")
"""Of the environment, whose other variables may be secret."""
_NEW_USER, _NEW_NETWORK = 0x10000000, 0x40000000
"""CLONE_NEWUSER and CLONE_NEWNET of unshare(2)."""


class Limits(NamedTuple):
    """What a process may take at most."""

    memory_bytes: int
    """Of addresses."""
    processor_s: int
    file_bytes: int
    open_files: int


def confine(limits: Limits) -> None:
    """Limit this process for good; before it has threads."""
    _leave_network()
    for kind, limit in (
        (resource.RLIMIT_AS, limits.memory_bytes),
        (resource.RLIMIT_CPU, limits.processor_s),
        (resource.RLIMIT_FSIZE, limits.file_bytes),
        (resource.RLIMIT_NOFILE, limits.open_files),
        (resource.RLIMIT_CORE, 0),
    ):
        _, most = resource.getrlimit(kind)
        limit = limit if most == resource.RLIM_INFINITY else min(limit, most)
        with suppress(ValueError, OSError):  # macOS takes no limit of addresses
            resource.setrlimit(kind, (limit, limit))


def bare_environment() -> dict[str, str]:
    """The environment of a confined process: how to start Python, and nothing else."""
    passed_on = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return passed_on | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


def how_ended(code: int, said: bytes) -> str:
    """How a process ended with an exit code, in words; `said`: on its standard error."""
    if code < 0:
        return signal.Signals(-code).name
    lines = said.decode(errors="replace").splitlines()
    return lines[-1] if lines else f"exit code {code}"


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
