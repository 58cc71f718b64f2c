"""Jobs as child processes of this machine.

A child that crashes, or hangs, or is killed for its memory takes nobody with it; being nicer than
the gateway, it yields the cores to live meetings.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping

from db.models import JobKind, JobRow
from services.jobs.engine import Ended
from services.jobs.scratch import clear_abandoned
from services.settings import Settings


class LocalEngine:
    """Runs as many jobs at once as `worker_slots` says."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._children: list[ChildProcess] = []
        clear_abandoned(settings.folders.scratch_dir)

    def kinds_with_room(self, waiting: Mapping[JobKind, int]) -> set[JobKind]:
        """See `Engine.kinds_with_room`."""
        self._children = [child for child in self._children if child.ended() is None]
        full = len(self._children) >= self._settings.jobs.worker_slots
        return set() if full else set(waiting)

    def start(self, job: JobRow) -> ChildProcess:
        """See `Engine.start`."""
        child = ChildProcess(
            job.id, job.attempt, self._settings, self._settings.child_environment()
        )
        self._children.append(child)
        return child

    def close(self) -> None:
        """See `Engine.close`: children stop by themselves once their parent is gone."""


class ChildProcess:
    """`services.jobs.child`, running one attempt at a job in a session of its own."""

    def __init__(
        self, job_id: str, attempt: int, settings: Settings, environment: dict[str, str]
    ) -> None:
        self._grace_s = settings.jobs.stop_grace_s
        self._scratch = settings.folders.scratch_dir
        self._asked_to_stop_s: float | None = None
        self._code: int | None = None
        self._process = subprocess.Popen(
            [sys.executable, "-m", "services.jobs.child", job_id, str(attempt)],
            env=environment,
            stdin=subprocess.PIPE,  # its end tells the child that we are gone
            start_new_session=True,
        )

    def poll(self) -> int | None:
        """Its exit code; None while it runs."""
        if self._code is None and (code := self._process.poll()) is not None:
            self._code = code
            if self._process.stdin is not None:
                self._process.stdin.close()
            clear_abandoned(self._scratch)
        return self._code

    def ended(self) -> Ended | None:
        """See `Execution.ended`."""
        code = self.poll()
        return None if code is None else Ended.with_code(code)

    def stop(self) -> None:
        """See `Execution.stop`."""
        if self.poll() is not None:
            return
        now = time.monotonic()
        if self._asked_to_stop_s is None:
            self._asked_to_stop_s = now
            self._process.terminate()
        elif now - self._asked_to_stop_s > self._grace_s:
            os.killpg(self._process.pid, signal.SIGKILL)
