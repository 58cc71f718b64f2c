"""The process of one job: `python -m services.jobs.child JOB_ID ATTEMPT`.

Its settings come by the environment. It stops on SIGTERM or when its parent is gone (end of its
standard input), and writes the job's end itself, together with the results, in one transaction.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from db.errors import DatabaseAway, NotFound, StoreAway, StoreFull
from db.models import JobKind, JobRow, JobState
from scene.errors import SceneError
from services import logs
from services.composition import build_services
from services.container import Services
from services.jobs.capture_job import run_capture
from services.jobs.events import QUEUE, job_topic
from services.jobs.export_job import run_export
from services.jobs.lease import JobLease
from services.jobs.queue import (
    STORE_AWAY,
    Orphan,
    drop_orphans,
    fail,
    finish,
    is_full,
    requeue,
    wait_for_room,
)
from services.jobs.report import JobStopped, Reporter
from services.jobs.scratch import scratch_folder
from services.jobs.train_job import run_train
from services.settings import Settings, load_settings
from services.tracing import PastSpan

log = logging.getLogger("services.jobs.child")

_AUTOGROUP = Path("/proc/self/autogroup")
Run = Callable[[Services, JobRow, Reporter, Path], None]
_RUNS: dict[JobKind, Run] = {
    JobKind.CAPTURE: run_capture,
    JobKind.TRAIN: run_train,
    JobKind.EXPORT: run_export,
}


def main(arguments: list[str]) -> int:
    """Run the job named on the command line.

    Exit code 0: the job's row says how it ended; `STORE_AWAY`: it should be tried again later.
    """
    job_id, attempt = arguments[0], int(arguments[1])
    settings = load_settings()
    give_way(settings.jobs.niceness)
    services = build_services(settings)
    logs.configure(settings.server.log_style, job_id=job_id, trace=services.tracing.here)
    try:
        return _run(services, settings, job_id, attempt)
    except (StoreAway, DatabaseAway, StoreFull) as error:  # full: the database's own disk
        log.warning("job %s could not go on: %s", job_id, error)
        return STORE_AWAY
    finally:
        services.close()


def give_way(niceness: int) -> None:
    """Have this process take only the cores' time that meetings leave.

    Linux weighs sessions first (autogroups, sched(7)) and the processes of each by niceness; this
    one has a session of its own, so niceness alone would give nothing to the gateway.
    """
    os.nice(niceness)
    with suppress(OSError):  # no Linux, or one that weighs processes alone
        _AUTOGROUP.write_text(str(niceness))


def _run(services: Services, settings: Settings, job_id: str, attempt: int) -> int:
    with services.reading() as unit:
        job = unit.jobs.get(job_id)
    if job.state is not JobState.RUNNING or job.attempt != attempt:
        log.info("job %s is no longer attempt %d's", job_id, attempt)
        return 0
    reporter = Reporter(services, JobLease(job_id, job.person_id, attempt))
    signal.signal(signal.SIGTERM, lambda *_: reporter.stop())
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    stop_with_parent = (reporter, settings.jobs.stop_grace_s)
    threading.Thread(target=_stop_with_parent, args=stop_with_parent, daemon=True).start()
    try:
        with (
            traced(services, job),
            scratch_folder(settings.folders.scratch_dir) as folder,
            reporter,
        ):
            _RUNS[job.kind](services, job, reporter, folder)
    except (StoreAway, DatabaseAway):
        raise  # not the job's fault, nor its end
    except Exception as error:
        if not isinstance(error, (SceneError, JobStopped)):
            log.exception("job %s failed", job_id)
        _end(services, job, error)
    services.events.publish(job_topic(job_id))
    services.events.publish(QUEUE)
    return 0


@contextmanager
def traced(services: Services, job: JobRow) -> Iterator[None]:
    """This attempt as a span of the trace that the job was asked for in, if there is one."""
    if job.attempt == 1:
        waited = PastSpan(
            f"{job.kind} job waits", job.created_at.timestamp(), services.clock().timestamp()
        )
        services.tracing.record(waited, parent=job.traceparent)
    notes = {"job.id": job.id, "job.attempt": job.attempt, "job.worker": job.worker or ""}
    with services.tracing.span(f"{job.kind} job", parent=job.traceparent, attributes=notes):
        yield


def _stop_with_parent(reporter: Reporter, grace_s: float) -> None:
    while os.read(sys.stdin.fileno(), 1):  # unbuffered: a lock would be held at the end
        pass
    reporter.stop()
    time.sleep(grace_s)
    os._exit(os.EX_SOFTWARE)  # it hangs, and nobody is left to kill it


def _end(services: Services, claimed: JobRow, error: Exception) -> None:
    now = services.clock()
    orphans: list[Orphan] = []
    with services.unit_of_work() as unit:
        try:
            job = unit.jobs.get(claimed.id)
        except NotFound:  # erased with its person
            return
        if job.state is not JobState.RUNNING or job.attempt != claimed.attempt:
            return
        if is_full(error):
            orphans = wait_for_room(unit, job, error, now, services.describe_failure)
        elif not isinstance(error, JobStopped):
            orphans = fail(unit, job, error, now, services.describe_failure)
        elif job.cancel_requested:
            orphans = finish(unit, job, JobState.CANCELLED, now, message="cancelled")
        else:
            requeue(job, "interrupted; waiting for a worker")
        unit.commit()
    drop_orphans(services, orphans)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
