"""Homes of jobs to test on: a Ray cluster of this machine, and workers of either kind."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from services.settings import Settings
from tests.servers import free_port
from tests.services.jobs.waiting import until

_OBJECT_STORE = 80_000_000
"""Bytes: as little as Ray takes, for jobs pass nothing through it."""


class RayCluster:
    """A head without processors, and nodes that come and go. They share no folder with a worker."""

    def __init__(self, settings: Settings, folder: Path) -> None:
        self.address = f"127.0.0.1:{free_port()}"
        self._environment = {
            **settings.child_environment(),
            "METANERF_DATA_DIR": str(folder),
            "RAY_kill_child_processes_on_worker_exit": "false",
            "RAY_raylet_start_wait_time_s": "120",  # beside whatever else runs
        }
        # sockets' paths must be short
        self._ray_folder = tempfile.TemporaryDirectory(prefix="ray-", ignore_cleanup_errors=True)
        self._nodes: list[subprocess.Popen[bytes]] = []
        port = self.address.rpartition(":")[2]
        own = ["--head", f"--port={port}", "--include-dashboard=false"]
        self._head = self._start(*own, "--num-cpus=0", f"--temp-dir={self._ray_folder.name}")
        until(self._answers, "the head of the cluster")

    def add_node(self, cpus: int) -> None:
        """As an autoscaler or a person adds one."""
        self._nodes.append(self._start(f"--address={self.address}", f"--num-cpus={cpus}"))

    def lose_nodes(self) -> None:
        """Every node but the head, without a word."""
        while self._nodes:
            _kill(self._nodes.pop())

    def asked_for(self) -> bool:
        """Whether somebody asks for a larger cluster than there is, or for just that."""
        command = [*_ray(), "status", "--address", self.address]
        told = subprocess.run(command, capture_output=True, text=True, env=self._environment)
        return "from request_resources" in told.stdout

    def close(self) -> None:
        """End it."""
        self.lose_nodes()
        _kill(self._head)
        self._ray_folder.cleanup()

    def _start(self, *options: str) -> subprocess.Popen[bytes]:
        store = f"--object-store-memory={_OBJECT_STORE}"
        return subprocess.Popen(
            [*_ray(), "start", *options, store, "--disable-usage-stats", "--block"],
            env=self._environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def _answers(self) -> bool:
        assert self._head.poll() is None, "the head of the cluster ended"
        host, _, port = self.address.rpartition(":")
        with suppress(OSError), socket.create_connection((host, int(port)), 1.0):
            return True
        return False


@contextmanager
def working(settings: Settings, engine: str, *kinds: str) -> Iterator[subprocess.Popen[str]]:
    """`metanerf worker`, stopped in the end as whoever operates it does."""
    words = ["worker", *kinds, "--engine", engine]
    process = subprocess.Popen(
        [sys.executable, "-c", "from services.cli import main; main()", *words],
        env=settings.child_environment(),
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        told = process.communicate(timeout=60)[1]
        print(told)  # shown where the test fails
    assert process.returncode in (0, -signal.SIGKILL), told


def _ray() -> list[str]:
    return [sys.executable, "-c", "from ray.scripts.scripts import main; main()"]


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
