"""Servers of one's own, which go away, hang and come back as they are told."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from scene.errors import InvalidInput

_STARTED_S = 60.0
METANERF = (sys.executable, "-c", "from services.cli import main; main()")
"""The program, before its command."""
_ELSEWHERE = "/usr/sbin:/usr/local/sbin"


def free_port() -> int:
    """A TCP port on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def program_path(name: str) -> str | None:
    """Where a server's program is installed; None: nowhere."""
    also = f"{_ELSEWHERE}:{Path(sys.executable).parent}"
    return shutil.which(name) or shutil.which(name, path=also)


def require_program(name: str) -> str:
    """Where a server's program is installed. Raises InvalidInput."""
    found = program_path(name)
    if found is None:
        raise InvalidInput(f"{name} must be installed to be killed; got none; install it")
    return found


class MortalServer:
    """A process, with whatever it starts in its group, that answers once it has started."""

    def __init__(
        self,
        command: Sequence[str],
        answers: Callable[[], bool],
        *,
        environment: Mapping[str, str] | None = None,
        user: str | None = None,
    ) -> None:
        """`answers` may raise OSError; `user`: who it runs as, if not as whoever starts it."""
        self._command, self._answers = list(command), answers
        self._environment, self._user = environment, user
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, *, wait: bool = True) -> None:
        """Return once it answers, or at once."""
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=None if self._environment is None else dict(self._environment),
            user=self._user,
            process_group=0,
        )
        if wait:
            self.wait()

    @property
    def runs(self) -> bool:
        """Whether it was started and has not ended."""
        return self._process is not None and self._process.poll() is None

    @property
    def process_id(self) -> int | None:
        """Of the process that was started last; None: none was."""
        return None if self._process is None else self._process.pid

    def wait(self) -> None:
        """Return once it answers. Raises RuntimeError where it ends instead, or takes too long."""
        deadline = time.monotonic() + _STARTED_S
        while time.monotonic() < deadline:
            if self._answering():
                return
            if self._process is None or self._process.poll() is not None:
                break
            time.sleep(0.05)
        raise RuntimeError(f"{self._command[0]} must start; got one that ended or never answered")

    def kill(self) -> None:
        """Gone without a word, with all that it has started in its group."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):  # ended by itself
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def end(self, within_s: float) -> None:
        """Told to end (SIGTERM), it does. Raises RuntimeError where it does not."""
        assert self._process is not None
        self._process.terminate()
        try:
            self._process.wait(within_s)
        except subprocess.TimeoutExpired as error:
            raise RuntimeError(f"{self._command[0]} must end when it is told to") from error

    def hang(self) -> None:
        """It keeps its connections and answers nobody, until it is killed."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def _answering(self) -> bool:
        try:
            return self._answers()
        except OSError:
            return False


class MortalRedis(MortalServer):
    """A Redis of one's own, which keeps nothing."""

    def __init__(self) -> None:
        port = free_port()
        self.url = f"redis://127.0.0.1:{port}/0"
        super().__init__(
            [require_program("redis-server"), "--port", str(port), "--save", ""], self._pongs
        )

    def _pongs(self) -> bool:
        import redis

        client = redis.Redis.from_url(self.url)
        try:
            return bool(client.ping())
        except redis.RedisError:
            return False
        finally:
            client.close()


class MortalPostgres(MortalServer):
    """A PostgreSQL of one's own, whose rows are in an empty `folder`, made here."""

    def __init__(self, folder: Path) -> None:
        port, user = free_port(), None
        folder.mkdir()
        if os.geteuid() == 0:  # it refuses to run as root
            user = "postgres"
            shutil.chown(folder, user)
        subprocess.run(
            [require_program("initdb"), "-D", folder, "-A", "trust", "-U", "root"],
            check=True,
            stdout=subprocess.DEVNULL,
            user=user,
        )
        self.url = f"postgresql+psycopg://root@127.0.0.1:{port}/postgres"
        options = ["-p", str(port), "-k", "", "-c", "listen_addresses=127.0.0.1"]
        super().__init__(
            [require_program("postgres"), "-D", str(folder), *options], self._selects, user=user
        )

    def _selects(self) -> bool:
        from sqlalchemy import create_engine, text
        from sqlalchemy.exc import OperationalError

        engine = create_engine(self.url, connect_args={"connect_timeout": 2})
        try:
            with engine.connect() as connection:
                return connection.execute(text("SELECT 1")).scalar() == 1
        except OperationalError:
            return False
        finally:
            engine.dispose()


class MortalObjects(MortalServer):
    """An S3 store of one's own with an empty bucket `test`; it forgets all when it ends."""

    def __init__(self) -> None:
        self.port = free_port()
        command = [require_program("moto_server"), "-H", "127.0.0.1", "-p", str(self.port)]
        super().__init__(command, self._has_a_bucket)

    def _has_a_bucket(self) -> bool:
        import httpx

        try:
            return httpx.put(f"http://127.0.0.1:{self.port}/test").is_success
        except httpx.TransportError:
            return False


def gateway_at(address: str, environment: dict[str, str]) -> MortalServer:
    """`metanerf serve` at an address of its own, with settings by `environment`; not started."""
    port = address.rpartition(":")[2]
    command = [*METANERF, "serve", "--port", port]
    environment = environment | {"METANERF_GATEWAY_URL": address}
    return MortalServer(command, lambda: _healthy(address), environment=environment)


def _healthy(address: str) -> bool:
    import httpx

    try:
        return httpx.get(f"{address}/healthz", timeout=2.0).status_code == 200
    except httpx.TransportError:
        return False
