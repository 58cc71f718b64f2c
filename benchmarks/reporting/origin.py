"""Where and when something was measured."""

from __future__ import annotations

import os
import platform
import time
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.reporting.checkout import Checkout

_TURNS, _TRIES = 300_000, 5

ORIGIN = ("date", "machine", "commit", "uncommitted_changes")
"""What `origin_of` tells."""


def origin_of(checkout: Checkout, now: datetime | None = None) -> dict[str, Any]:
    """Date (UTC), machine and commit of a measurement that begins now, as JSON.

    `now`: None: the machine's clock.
    """
    began = datetime.now(UTC) if now is None else now.astimezone(UTC)
    return {
        "date": began.isoformat(timespec="seconds"),
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "load_before": round(os.getloadavg()[0], 2),
            "loop_ms": loop_ms(),
            "python": platform.python_version(),
            "torch": version("torch"),
        },
        "commit": checkout.commit(),
        "uncommitted_changes": bool(checkout.uncommitted_paths()),
    }


def loop_ms() -> float:
    """Processor time of a fixed loop of the interpreter, the shortest of a few tries.

    The same processor's name stands for machines that differ by a factor of two, by what their
    neighbours do: where figures of two days differ, this says whether the code or the machine did.
    """
    tries = []
    for _ in range(_TRIES):
        began, total = time.process_time(), 0
        for number in range(_TURNS):
            total += number
        tries.append(time.process_time() - began)
    return round(1e3 * min(tries), 1)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()
