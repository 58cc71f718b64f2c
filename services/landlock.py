"""Which files a process may reach from now on, by Linux' Landlock.

Source: the kernel's userspace-api/landlock. Who runs a hostile file's code is of the same user as
the service, whose files are the user's: without this it could read its secrets and database.
"""

from __future__ import annotations

import ctypes
import os
import stat
import struct
from collections.abc import Iterable
from pathlib import Path

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
"""Numbers of the system calls, on every processor."""
_VERSION_FLAG, _PATH_BENEATH = 1, 1
_NO_NEW_PRIVILEGES = 38
"""PR_SET_NO_NEW_PRIVS of prctl(2), without which only root may restrict itself."""
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 2, 4, 8
_REFER, _TRUNCATE, _IOCTL = 1 << 13, 1 << 14, 1 << 15
_SINCE_FIRST = (1 << 13) - 1
"""All that the first version knows: beside these four, what makes and removes entries."""
_OF_A_FILE = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL
_TCP = 0b11
"""Binding and connecting."""
_SCOPES = 0b11
"""Abstract sockets and signals, of processes outside."""


def restrict_files(
    readable: Iterable[Path], writable: Iterable[Path], listable: Iterable[Path] = ()
) -> bool:
    """Let this process, before it has threads, reach only what lies at or below these paths.

    Args: readable: may be read and run. writable: anything may be done there. listable: only names
        of entries are told. Paths that do not exist are left out.

    Nor may it connect by TCP, or send signals, where the kernel can hold that back. Returns False
    where the kernel has no Landlock: then nothing has changed.
    """
    library = ctypes.CDLL(None, use_errno=True)
    version = library.syscall(_CREATE_RULESET, None, 0, _VERSION_FLAG)
    if version < 1:
        return False
    handled = _SINCE_FIRST
    for since, access in ((2, _REFER), (3, _TRUNCATE), (5, _IOCTL)):
        handled |= access if version >= since else 0
    # later fields are unknown to earlier kernels, which take them while they are nil
    attributes = struct.pack(
        "<QQQ", handled, _TCP if version >= 4 else 0, _SCOPES if version >= 6 else 0
    )
    ruleset = _checked(library.syscall(_CREATE_RULESET, attributes, len(attributes), 0))
    for paths, access in (
        (readable, _EXECUTE | _READ_FILE | _READ_DIR),
        (writable, handled),
        (listable, _READ_DIR),
    ):
        for path in paths:
            _allow(library, ruleset, path, access & handled)
    _checked(library.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0))
    _checked(library.syscall(_RESTRICT_SELF, ruleset, 0))
    os.close(ruleset)
    return True


def _allow(library: ctypes.CDLL, ruleset: int, path: Path, access: int) -> None:
    try:
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(opened).st_mode):
            access &= _OF_A_FILE
        rule = struct.pack("<Qi", access, opened)
        _checked(library.syscall(_ADD_RULE, ruleset, _PATH_BENEATH, rule, 0))
    finally:
        os.close(opened)


def _checked(result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result
