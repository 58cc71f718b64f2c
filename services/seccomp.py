"""Which system calls a process may make from now on, by Linux' seccomp.

Source: the kernel's userspace-api/seccomp_filter. A process that may not have a network of its own
needs no privilege for this; nor are Unix sockets, by which databases listen, of any network.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import sys
from typing import NamedTuple

_NO_NEW_PRIVILEGES, _SET_SECCOMP, _FILTER = 38, 22, 2
"""PR_SET_NO_NEW_PRIVS and PR_SET_SECCOMP of prctl(2), SECCOMP_MODE_FILTER."""
_LOAD, _IF_EQUAL, _IF_AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06
"""Of classic BPF: BPF_LD | BPF_W | BPF_ABS and so on."""
_NUMBER_AT, _ARCHITECTURE_AT = 0, 4
"""Bytes into seccomp_data."""
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | errno.EPERM
_X32 = 0x40000000
"""Numbers from here on are of x86-64's second set of calls; no other processor has them."""


class _Calls(NamedTuple):
    """Numbers of a processor."""

    architecture: int
    """AUDIT_ARCH of linux/audit.h."""
    socket: int
    ptrace: int
    process_vm_readv: int
    process_vm_writev: int


CALLS = {
    "x86_64": _Calls(0xC000003E, 41, 101, 310, 311),
    "aarch64": _Calls(0xC00000B7, 198, 117, 270, 271),
}
_IO_URING_SETUP, _PIDFD_GETFD = 425, 438
"""On every processor. The first opens sockets, too; the second takes those of others."""


def refuse_sockets() -> bool:
    """Let this process, before it has threads, and all that it starts, open no socket and reach
    into no other process: EPERM. What is open stays open.

    Returns False where the system or the processor is none that this knows: nothing has changed.
    """
    calls = CALLS.get(platform.machine())
    if sys.platform != "linux" or calls is None:
        return False
    program = _filter(calls)
    count, held = len(program) // 8, ctypes.create_string_buffer(program)
    # struct sock_fprog, padded to the pointer
    described = ctypes.create_string_buffer(struct.pack("@HP", count, ctypes.addressof(held)))
    library = ctypes.CDLL(None, use_errno=True)
    if library.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return library.prctl(_SET_SECCOMP, _FILTER, described, 0, 0) == 0


def _filter(calls: _Calls) -> bytes:
    """Instructions (struct sock_filter): of another architecture everything is refused, too."""
    refused = (*calls[1:], _IO_URING_SETUP, _PIDFD_GETFD)
    # a jump counts the instructions that it leaves out
    last = len(refused)
    steps = [
        (_LOAD, 0, 0, _ARCHITECTURE_AT),
        (_IF_EQUAL, 0, last + 3, calls.architecture),
        (_LOAD, 0, 0, _NUMBER_AT),
        (_IF_AT_LEAST, last + 1, 0, _X32),
        *((_IF_EQUAL, last - at, 0, number) for at, number in enumerate(refused)),
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, _REFUSE),
    ]
    return b"".join(struct.pack("<HBBI", *step) for step in steps)
