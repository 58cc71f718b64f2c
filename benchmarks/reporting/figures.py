"""What every benchmark's JSON carries: the command, the machine, the commit."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any


def write_report(path: Path | None, name: str, figures: dict[str, Any]) -> None:
    """Print `figures`, and write them with where they come from to `path` if there is one."""
    # a file's folder is this machine's business alone
    command = " ".join(Path(word).name if word.startswith("/") else word for word in sys.argv[1:])
    report = {"benchmark": name, "command": command, **machine(), **figures}
    print(json.dumps(report, indent=1))
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(report, indent=1) + "\n")


def machine() -> dict[str, Any]:
    """Processor, cores, load before the run, Python, commit."""
    return {
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "load_before": round(os.getloadavg()[0], 2),
            "python": platform.python_version(),
        },
        "commit": _commit(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()


@cache
def _commit() -> str:
    """As the run began: a report that is written anew each time would else change it."""
    done = subprocess.run(
        ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout.strip() or "unknown"
