"""Where jobs run: what a worker asks of the home of its jobs, whichever that is.

A worker leases jobs from the database (`services.jobs.lease`) and has an engine do their work. The
row stays the truth of a job: an engine neither queues nor retries, and what it says of an execution
counts only where the row does not tell the job's end already.
"""

from __future__ import annotations

import signal
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from db.models import JobKind, JobRow
from scene.errors import SceneError
from services.jobs.queue import STORE_AWAY


class EngineAway(SceneError):
    """The home of jobs does not answer; jobs wait meanwhile."""


@dataclass(frozen=True)
class Ended:
    """How an execution ended, for a row that says nothing of it."""

    reason: str
    is_crash: bool
    """Whether the job may be at fault; otherwise it is tried again as often as it takes."""

    @classmethod
    def with_code(cls, code: int) -> Ended:
        """How a job's process ended that left this exit code; negative: by that signal."""
        if code == STORE_AWAY:
            return cls("the database or the object store was away or full", is_crash=False)
        if code == -signal.SIGKILL:
            return cls("its process was killed, as happens when memory runs out", is_crash=True)
        if code < 0:
            return cls(f"its process died of {signal.Signals(-code).name}", is_crash=True)
        return cls(f"its process ended with code {code}", is_crash=True)


class Execution(Protocol):
    """The work of one attempt at a job, wherever it is done."""

    def ended(self) -> Ended | None:
        """How it ended; None while it goes on."""
        ...

    def stop(self) -> None:
        """Have it leave a checkpoint and go. Called again and again until it has ended: what has
        not gone after the grace that is set is killed."""
        ...


class Engine(Protocol):
    """A home of jobs. Used by one thread."""

    def kinds_with_room(self, waiting: Mapping[JobKind, int]) -> set[JobKind]:
        """Of which of the kinds of jobs that wait, and how many do, one more could run now.

        Raises EngineAway.
        """
        ...

    def start(self, job: JobRow) -> Execution:
        """Begin the attempt at a job that was just leased."""
        ...

    def close(self) -> None:
        """Let go of everything; what still runs is stopped."""
        ...
