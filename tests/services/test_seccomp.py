"""A process that may open no sockets opens none, whoever it runs as and however it asks."""

from __future__ import annotations

import ctypes
import os
import platform
import subprocess
import sys

import pytest

from services import seccomp

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() not in ("x86_64", "aarch64"),
    reason="the filter is for Linux on x86-64 and Arm",
)
BEGUN = """
import ctypes, os, socket, threading
from services.seccomp import refuse_sockets
if os.geteuid() == 0:
    os.setuid(65534)  # nobody: it takes no privilege
assert refuse_sockets()
call = ctypes.CDLL(None, use_errno=True).syscall
def refused(*arguments):
    ctypes.set_errno(0)
    return call(*arguments) == -1 and ctypes.get_errno() == 1
"""


def run(code: str) -> subprocess.CompletedProcess[str]:
    """What a process does that may open no sockets."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.run(
        [sys.executable, "-c", BEGUN + code],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )


@pytest.mark.parametrize("family", ["AF_INET", "AF_INET6", "AF_UNIX", "AF_NETLINK"])
def test_no_socket_is_opened(family: str):
    assert "PermissionError" in run(f"socket.socket(socket.{family}, socket.SOCK_RAW)").stderr


def test_nor_by_what_it_starts_nor_by_its_threads():
    by_a_child = "if os.fork():\n    os.wait()\nelse:\n    socket.socket()"
    assert "PermissionError" in run(by_a_child).stderr
    assert "PermissionError" in run("threading.Thread(target=socket.socket).start()").stderr


@pytest.mark.parametrize(
    "call",
    [
        # io_uring, by which sockets are opened without a call
        "425, 8, ctypes.create_string_buffer(120)",
        "438, 3, 1, 0",
        *(
            f"{getattr(seccomp.CALLS.get(platform.machine()), name, 0)}, 0, 0, 0, 0, 0, 0"
            for name in ("ptrace", "process_vm_readv", "process_vm_writev")
        ),
    ],
)
def test_nor_is_another_process_reached(call: str):
    assert run(f"print(refused({call}))").stdout == "True\n"


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the second set of calls is x86-64's")
def test_a_processors_other_set_of_calls_is_no_way_round():
    # getpid of the second set: without the filter a kernel that lacks it answers ENOSYS
    assert run("print(refused(0x40000000 + 39))").stdout == "True\n"


def test_what_needs_no_socket_goes_on():
    done = run("print(socket.socketpair()[0].family.name, len(os.listdir('/')) > 1)")
    assert done.stdout == "AF_UNIX True\n"


def test_another_processor_is_left_as_it_was(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    before = ctypes.CDLL(None).prctl(39, 0, 0, 0, 0)
    assert not seccomp.refuse_sockets()
    assert ctypes.CDLL(None).prctl(39, 0, 0, 0, 0) == before
