"""A worker's lease on a job: renewed by heartbeats, void once somebody else was given the job.

As in Chubby (Burrows 2006) and SQS's visibility timeout: a job is leased to one worker at a time.
Whoever misses heartbeats for `job_heartbeat_timeout_s` has lost the lease, the job is queued again,
and its next attempt has a number that the last holder's writes no longer match.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from db.repositories import UnitOfWork
from services.jobs.queue import DescribeFailure, Orphan, crashed


@dataclass(frozen=True)
class JobLease:
    """The right to work on a job, for one attempt at it."""

    job_id: str
    person_id: str
    attempt: int

    def renew(self, unit: UnitOfWork, now: datetime, values: dict[str, Any] | None = None) -> bool:
        """Write a heartbeat, and `values` with it; False where the lease is lost."""
        return unit.jobs.write(self.job_id, self.attempt, {"heartbeat_at": now, **(values or {})})


def reclaim_expired(
    unit: UnitOfWork,
    now: datetime,
    timeout_s: float,
    describe: DescribeFailure,
    *,
    at_most: int,
) -> tuple[list[str], list[Orphan]]:
    """Take back jobs whose lease was not renewed for `timeout_s`: which, and what to delete.

    Each is queued again, or given up after `at_most` crashes.
    """
    expired = unit.jobs.with_expired_lease(now - timedelta(seconds=timeout_s))
    orphans: list[Orphan] = []
    for job in expired:
        orphans += crashed(unit, job, "its worker went silent", now, describe, at_most=at_most)
    return [job.id for job in expired], orphans
