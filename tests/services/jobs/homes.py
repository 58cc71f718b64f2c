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

from services.settings import Settings, load_settings
from tests.servers import free_port, fresh_database
from tests.services.jobs.waiting import until

_OBJECT_STORE = 80_000_000
"""Bytes: as little as Ray takes, for jobs pass nothing through it."""


@contextmanager
def deployed(
    folder: Path, redis_url: str, s3_endpoint: str, **changes: object
) -> Iterator[Settings]:
    """Settings of a worker, and of nodes but for the folder: with all servers behind them."""
    with fresh_database("postgresql", folder) as url:
        yield load_settings(
            data_dir=folder / "worker",
            database_url=url,
            redis_url=redis_url,
            object_store_url="s3://test",
            s3_endpoint_url=s3_endpoint,
            s3_access_key_id="test",
            s3_secret_access_key="test",
            job_niceness=0,
            job_heartbeat_timeout_s=5.0,
            job_stop_grace_s=4.0,
            log_level="info",
            **changes,
        )


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
        self._head: subprocess.Popen[bytes] | None = None

    def start_head(self) -> None:
        """Until then nobody answers at the address."""
        port = self.address.rpartition(":")[2]
        own = ["--head", f"--port={port}", "--include-dashboard=false"]
        self._head = self._start(*own, "--num-cpus=0", f"--temp-dir={self._ray_folder.name}")
        until(self._answers, "the head of the cluster")

    def add_node(self, cpus: int) -> None:
        """As an autoscaler or a person adds one."""
        self._nodes.append(self._start(f"--address={self.address}", f"--num-cpus={cpus}"))

    def lose_nodes(self) -> None:
        """Every node but the head, without a word, with the jobs that run there."""
        while self._nodes:
            node = self._nodes.pop()
            for process_id in _descendants(node.pid):
                with suppress(ProcessLookupError):
                    os.kill(process_id, signal.SIGKILL)
            _kill(node)

    def asked_for(self) -> bool:
        """Whether somebody asks for a larger cluster than there is, or for just that."""
        command = [*_ray(), "status", "--address", self.address]
        told = subprocess.run(command, capture_output=True, text=True, env=self._environment)
        return "from request_resources" in told.stdout

    def close(self) -> None:
        """End it."""
        self.lose_nodes()
        if self._head is not None:
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
        assert self._head is not None
        assert self._head.poll() is None, "the head of the cluster ended"
        host, _, port = self.address.rpartition(":")
        with suppress(OSError), socket.create_connection((host, int(port)), 1.0):
            return True
        return False


class WorkerProcess:
    """`metanerf worker`, and what it has said."""

    def __init__(self, settings: Settings, words: list[str], log: Path) -> None:
        self._log = log
        with log.open("w") as file:
            self._process = subprocess.Popen(
                [sys.executable, "-c", "from services.cli import main; main()", "worker", *words],
                env=settings.child_environment(),
                stderr=file,
            )

    def told(self) -> str:
        """Its log so far."""
        return self._log.read_text()

    def kill(self) -> None:
        """End it without a word."""
        self._process.kill()

    def stop(self) -> int:
        """End it as whoever operates it does; its exit code."""
        self._process.terminate()
        return self._process.wait(timeout=60)


@contextmanager
def working(settings: Settings, engine: str, *kinds: str) -> Iterator[WorkerProcess]:
    """A worker that is stopped in the end."""
    with tempfile.TemporaryDirectory() as folder:
        words = [*kinds, "--engine", engine]
        worker = WorkerProcess(settings, words, Path(folder) / "log")
        try:
            yield worker
        finally:
            code = worker.stop()
            print(worker.told())  # shown where the test fails
        assert code in (0, -signal.SIGKILL), worker.told()


def _ray() -> list[str]:
    return [sys.executable, "-c", "from ray.scripts.scripts import main; main()"]


def parent_of(process_id: int) -> int:
    """The id of the process that started another. Raises OSError where that has ended."""
    status = Path(f"/proc/{process_id}/stat").read_text()
    return int(status.rpartition(") ")[2].split()[1])


def _descendants(process_id: int) -> list[int]:
    """Ids of what a process has started, and of what these have; parents first."""
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            children.setdefault(parent_of(int(folder.name)), []).append(int(folder.name))
    found, left = [], [process_id]
    while left:
        found += (born := children.get(left.pop(), []))
        left += born
    return found


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
