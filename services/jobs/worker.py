"""Leases jobs from the queue and has an engine run them: children of this process, or a cluster.

A worker that dies takes no job with it: what it ran leaves a checkpoint and goes, or loses its
lease (`services.jobs.lease`), and others take over.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
import time
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime

from prometheus_client import Gauge, Histogram

from db.errors import DatabaseError, NotFound
from db.models import JobKind, JobRow, JobState
from db.repositories import UnitOfWork
from db.sweep import sweep
from services.container import Services
from services.jobs.engine import Ended, Engine, EngineAway, Execution
from services.jobs.events import QUEUE, job_topic
from services.jobs.lease import JobLease, reclaim_expired
from services.jobs.queue import Orphan, crashed, drop_orphans, interrupted
from services.retention import forget_old

log = logging.getLogger(__name__)

ATTEMPTS = Histogram(
    "metanerf_job_attempt_seconds",
    "Attempts at jobs by this worker, by kind and what became of them, s.",
    ["kind", "outcome"],
    buckets=(5, 15, 30, 60, 120, 300, 600, 1800, 3600),
)
"""ended (the job's row says how); crashed; interrupted (for no fault of the job)."""
RUNNING = Gauge("metanerf_job_attempts", "Attempts at jobs by this worker now.", ["kind"])
_START_S = 90.0
"""Time an execution has to give its first sign of life; its worker's count for it till then."""
_POLL_S = 0.5
"""How often executions and the queue are looked at."""
_PAUSE_S = 3.0
"""After an execution ended for no fault of its job, before another job is begun."""
_SWEEP_INTERVAL_S = 3600.0
_LAST_WORDS_S = 5.0
"""Beyond the grace of a stopped execution, until a worker that stops goes without its end."""


@dataclass(eq=False)
class _Running:
    lease: JobLease
    execution: Execution
    kind: JobKind
    renewed_at: datetime | None
    """Our last sign of life for it: a heartbeat that is another is the execution's own."""
    started_s: float = field(default_factory=time.monotonic)


class Worker:
    """Runs jobs of some kinds until it is stopped."""

    def __init__(self, services: Services, kinds: Collection[JobKind], engine: Engine) -> None:
        self._services, self._kinds, self._engine = services, list(kinds), engine
        self._name = f"{socket.gethostname()}:{os.getpid()}"
        self._running: list[_Running] = []
        self._swept_s: float | None = None
        self._rests_until_s = 0.0
        self._engine_is_away = False

    def run(self, stop: threading.Event) -> None:
        """Work until `stop` is set; then let executions leave their checkpoints and go."""
        try:
            while not stop.is_set():
                try:
                    self._poll()
                except DatabaseError as error:
                    log.warning("the queue can't be read: %s", error)
                self._services.events.wait(QUEUE, _POLL_S)
        finally:
            self._stop_all()
            self._engine.close()

    def _poll(self) -> None:
        for one in list(self._running):
            self._watch(one)
        self._reclaim_expired()
        if time.monotonic() >= self._rests_until_s:
            self._take_jobs()
        self._sweep_now_and_then()

    def _take_jobs(self) -> None:
        with self._services.reading() as unit:
            waiting = unit.jobs.waiting(self._kinds, self._services.clock())
        while True:
            kinds = self._kinds_with_room(waiting)
            job = self._claim(kinds) if kinds else None
            if job is None:
                return
            told = {"job_id": job.id}
            log.info("job %s (%s), attempt %d", job.id, job.kind, job.attempt, extra=told)
            lease = JobLease(job.id, job.person_id, job.attempt)
            execution = self._engine.start(job)
            self._running.append(_Running(lease, execution, job.kind, job.heartbeat_at))
            RUNNING.labels(job.kind.value).inc()
            waiting[job.kind] -= 1

    def _kinds_with_room(self, waiting: dict[JobKind, int]) -> set[JobKind]:
        """Empty while the engine is away, which is told once as it goes and once as it is back."""
        try:
            kinds = self._engine.kinds_with_room({k: n for k, n in waiting.items() if n > 0})
        except EngineAway as error:
            if not self._engine_is_away:
                log.error("jobs wait: %s", error)
            self._engine_is_away = True
            return set()
        if self._engine_is_away:
            log.warning("jobs are run again")
        self._engine_is_away = False
        return kinds

    def _claim(self, kinds: Collection[JobKind]) -> JobRow | None:
        with self._services.unit_of_work() as unit:
            job = unit.jobs.claim(kinds, self._name, self._services.clock())
            if job is not None:
                job.message = "starting"
            unit.commit()
        if job is not None:
            self._services.events.publish(job_topic(job.id))
        return job

    def _watch(self, running: _Running) -> None:
        ended = running.execution.ended()
        if ended is not None:
            self._reap(running, ended)
            return
        job = self._wanted(running)
        if job is None:
            running.execution.stop()
        elif job.heartbeat_at == running.renewed_at:
            if time.monotonic() - running.started_s < _START_S:
                self._renew_lease(running)
            else:
                running.execution.stop()

    def _renew_lease(self, running: _Running) -> None:
        with self._services.unit_of_work() as unit:
            now = self._services.clock()
            # locks the row: a heartbeat that came meanwhile is seen, and is not ours
            if running.lease.renew(unit, now):
                running.renewed_at = now
            unit.commit()

    def _wanted(self, running: _Running) -> JobRow | None:
        """The row of a job that is still ours and is to go on."""
        with self._services.reading() as unit:
            try:
                job = unit.jobs.get(running.lease.job_id)
            except NotFound:
                return None
        ours = job.state is JobState.RUNNING and job.attempt == running.lease.attempt
        return job if ours and not job.cancel_requested else None

    def _reap(self, running: _Running, ended: Ended) -> None:
        self._running.remove(running)
        RUNNING.labels(running.kind.value).dec()
        orphans: list[Orphan] = []
        with self._services.unit_of_work() as unit:
            # locks the row; matches only where the execution left no end of its own
            left = running.lease.renew(unit, self._services.clock())
            if left:
                orphans = self._given_back(unit, unit.jobs.get(running.lease.job_id), ended)
            unit.commit()
        outcome = "ended" if not left else "crashed" if ended.is_crash else "interrupted"
        seconds = time.monotonic() - running.started_s
        ATTEMPTS.labels(running.kind.value, outcome).observe(seconds)
        drop_orphans(self._services, orphans)
        self._services.events.publish(job_topic(running.lease.job_id))

    def _given_back(self, unit: UnitOfWork, job: JobRow, ended: Ended) -> list[Orphan]:
        """What to delete of a job whose execution left no end of its own."""
        now = self._services.clock()
        if not ended.is_crash:
            self._rests_until_s = time.monotonic() + _PAUSE_S
            return interrupted(unit, job, ended.reason, now)
        return crashed(
            unit,
            job,
            ended.reason,
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
            told = {"job_id": job_id}
            log.warning("job %s went silent and was taken back", job_id, extra=told)
            self._services.events.publish(job_topic(job_id))

    def _sweep_now_and_then(self) -> None:
        now = time.monotonic()
        if self._swept_s is not None and now - self._swept_s < _SWEEP_INTERVAL_S:
            return
        self._swept_s = now
        swept = sweep(self._services.unit_of_work, self._services.objects, self._services.clock())
        if swept.objects or swept.incoming or swept.uploads:
            log.info("%s", swept)
        forgotten = forget_old(self._services)
        if forgotten.recordings or forgotten.clips or forgotten.events:
            log.info("%s", forgotten)

    def _stop_all(self) -> None:
        grace_s = self._services.settings.jobs.stop_grace_s
        give_up_s = time.monotonic() + grace_s + _LAST_WORDS_S
        while self._running and time.monotonic() < give_up_s:
            for one in list(self._running):
                one.execution.stop()
                if (ended := one.execution.ended()) is None:
                    continue
                try:
                    self._reap(one, ended)
                except DatabaseError as error:
                    log.warning(
                        "job %s stays as it is until it is taken back: %s", one.lease.job_id, error
                    )
            time.sleep(0.05)
