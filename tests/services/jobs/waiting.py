"""Waiting for what real processes do, with an end that fails the test."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import httpx

Found = TypeVar("Found")
PATIENCE_S = 90.0
"""Long beyond what is awaited, for a machine that does much else."""


def until(look: Callable[[], Found | None], what: str, patience_s: float = PATIENCE_S) -> Found:
    """What `look` finds as soon as it finds something."""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        if found := look():
            return found
        time.sleep(0.1)
    raise AssertionError(f"{what} did not happen within {patience_s:g} s")


def job_when(
    caller: httpx.Client, job_id: str, fits: Callable[[dict[str, Any]], bool], what: str
) -> dict[str, Any]:
    """The job as soon as it fits."""

    def look() -> dict[str, Any] | None:
        job = caller.get(f"/v1/jobs/{job_id}").json()
        return job if fits(job) else None

    return until(look, what)


def child_of(job_id: str) -> int:
    """The id of the process that runs a job."""

    def look() -> int | None:
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                words = (folder / "cmdline").read_bytes().split(b"\0")
            except (FileNotFoundError, ProcessLookupError):
                continue
            if b"services.jobs.child" in words and job_id.encode() in words:
                return int(folder.name)
        return None

    return until(look, "the job's process")
