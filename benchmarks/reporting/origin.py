"""Where and when something was measured."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.reporting.checkout import Checkout

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
            "python": platform.python_version(),
            "torch": version("torch"),
        },
        "commit": checkout.commit(),
        "uncommitted_changes": bool(checkout.uncommitted_paths()),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()
