"""Claims jobs and runs each in a child process of its own.

A child that crashes, or hangs, or is killed for its memory takes nobody with it; being nicer than
the gateway, it yields the cores to live meetings. A worker that dies no longer renews its leases
(`services.jobs.lease`), and others take over its jobs.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Collection
from dataclasses import dataclass, field

from db.errors import DatabaseError, NotFound
from db.models import JobKind, JobRow, JobState
from db.repositories import UnitOfWork
from db.sweep import sweep
from services.container import Services
from services.jobs.events import QUEUE, job_topic
from services.jobs.lease import JobLease, reclaim_expired
from services.jobs.queue import STORE_AWAY, Orphan, crashed, drop_orphans, interrupted
from services.jobs.scratch import clear_abandoned

log = logging.getLogger(__name__)

_START_S = 60.0
"""Time a child has to import what it needs; its worker's signs of life count for it till then."""
_POLL_S = 0.5
"""How often children and the queue are looked at."""
_STORE_PAUSE_S = 3.0
"""After a store went away under a job, before another job is begun."""


@dataclass(eq=False)
class _Child:
    lease: JobLease
    process: subprocess.Popen[bytes]
    started_s: float = field(default_factory=time.monotonic)
    asked_to_stop_s: float | None = field(default=None)


class Worker:
    """Runs jobs of some kinds until it is stopped."""

    def __init__(self, services: Services, kinds: Collection[JobKind]) -> None:
        self._services, self._kinds = services, list(kinds)
        self._name = f"{socket.gethostname()}:{os.getpid()}"
        self._children: list[_Child] = []
        self._swept_s: float | None = None
        self._rests_until_s = 0.0

    def run(self, stop: threading.Event) -> None:
        """Work until `stop` is set; then let children leave their checkpoints and go."""
        settings = self._services.settings
        clear_abandoned(settings.folders.scratch_dir)
        try:
            while not stop.is_set():
                try:
                    self._poll()
                except DatabaseError as error:
                    log.warning("the queue can't be read: %s", error)
                self._services.events.wait(QUEUE, _POLL_S)
        finally:
            self._stop_children()

    def _poll(self) -> None:
        for child in list(self._children):
            self._watch(child)
        self._reclaim_expired()
        slots = self._services.settings.jobs.worker_slots
        while len(self._children) < slots and time.monotonic() >= self._rests_until_s:
            job = self._claim()
            if job is None:
                break
            self._children.append(self._start(job))
        self._sweep_now_and_then()

    def _claim(self) -> JobRow | None:
        with self._services.unit_of_work() as unit:
            job = unit.jobs.claim(self._kinds, self._name, self._services.clock())
            if job is not None:
                job.message = "starting"
            unit.commit()
        if job is not None:
            self._services.events.publish(job_topic(job.id))
        return job

    def _start(self, job: JobRow) -> _Child:
        log.info("job %s (%s), attempt %d", job.id, job.kind, job.attempt)
        process = subprocess.Popen(
            [sys.executable, "-m", "services.jobs.child", job.id, str(job.attempt)],
            env=self._services.settings.child_environment(),
            stdin=subprocess.PIPE,  # its end tells the child that we are gone
            start_new_session=True,
        )
        return _Child(JobLease(job.id, job.person_id, job.attempt), process)

    def _watch(self, child: _Child) -> None:
        code = child.process.poll()
        if code is None:
            if not self._is_wanted(child):
                self._stop(child)
            elif time.monotonic() - child.started_s < _START_S:
                self._renew_lease(child)
            return
        self._children.remove(child)
        self._reap(child, code)

    def _renew_lease(self, child: _Child) -> None:
        with self._services.unit_of_work() as unit:
            now = self._services.clock()
            child.lease.renew(unit, now)
            unit.commit()

    def _is_wanted(self, child: _Child) -> bool:
        with self._services.reading() as unit:
            try:
                job = unit.jobs.get(child.lease.job_id)
            except NotFound:
                return False
        ours = job.state is JobState.RUNNING and job.attempt == child.lease.attempt
        return ours and not job.cancel_requested

    def _stop(self, child: _Child) -> None:
        now = time.monotonic()
        if child.asked_to_stop_s is None:
            child.asked_to_stop_s = now
            child.process.terminate()
        elif now - child.asked_to_stop_s > self._services.settings.jobs.stop_grace_s:
            os.killpg(child.process.pid, signal.SIGKILL)

    def _reap(self, child: _Child, code: int) -> None:
        if child.process.stdin is not None:
            child.process.stdin.close()
        clear_abandoned(self._services.settings.folders.scratch_dir)
        orphans: list[Orphan] = []
        with self._services.unit_of_work() as unit:
            # locks the row; matches only where the child left no end of its own
            left = child.lease.renew(unit, self._services.clock())
            if left:
                orphans = self._given_back(unit, unit.jobs.get(child.lease.job_id), code)
            unit.commit()
        drop_orphans(self._services, orphans)
        self._services.events.publish(job_topic(child.lease.job_id))

    def _given_back(self, unit: UnitOfWork, job: JobRow, code: int) -> list[Orphan]:
        """What to delete of a job whose child ended with `code` and left no end of its own."""
        now = self._services.clock()
        if code == STORE_AWAY:
            self._rests_until_s = time.monotonic() + _STORE_PAUSE_S
            return interrupted(unit, job, "the database or the object store was away", now)
        return crashed(
            unit,
            job,
            _cause(code),
            now,
            self._services.describe_failure,
            at_most=self._services.settings.jobs.max_crashes,
        )

    def _reclaim_expired(self) -> None:
        settings = self._services.settings
        with self._services.unit_of_work() as unit:
            reclaimed, orphans = reclaim_expired(
                unit,
                self._services.clock(),
                settings.jobs.heartbeat_timeout_s,
                self._services.describe_failure,
                at_most=settings.jobs.max_crashes,
            )
            unit.commit()
        drop_orphans(self._services, orphans)
        for job_id in reclaimed:
            log.warning("job %s went silent and was taken back", job_id)
            self._services.events.publish(job_topic(job_id))

    def _sweep_now_and_then(self) -> None:
        settings, now = self._services.settings, time.monotonic()
        if self._swept_s is not None and now - self._swept_s < settings.jobs.sweep_interval_s:
            return
        self._swept_s = now
        swept = sweep(self._services.unit_of_work, self._services.objects, self._services.clock())
        if swept.objects or swept.incoming or swept.uploads:
            log.info("%s", swept)

    def _stop_children(self) -> None:
        for child in self._children:
            child.process.terminate()
        deadline = time.monotonic() + self._services.settings.jobs.stop_grace_s
        for child in self._children:
            try:
                code = child.process.wait(max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(child.process.pid, signal.SIGKILL)
                code = child.process.wait()
            try:
                self._reap(child, code)
            except DatabaseError as error:
                log.warning(
                    "job %s stays as it is until it is taken back: %s", child.lease.job_id, error
                )
        self._children.clear()


def _cause(code: int) -> str:
    if code == -signal.SIGKILL:
        return "its process was killed, as happens when memory runs out"
    if code < 0:
        return f"its process died of {signal.Signals(-code).name}"
    return f"its process ended with code {code}"
