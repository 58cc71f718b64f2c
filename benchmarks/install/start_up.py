"""How long fresh interpreters take to import a module, to print help, to answer a request."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import httpx

from benchmarks.reporting.checkout import ROOT
from benchmarks.service import RESIDENT, metric, running_demo

_TRIES = 3
_IMPORT = """
import sys, time
wall, processor = time.perf_counter(), time.process_time()
__import__(sys.argv[1])
print(time.perf_counter() - wall, time.process_time() - processor)
"""


def import_ms(module: str, tries: int = _TRIES) -> dict[str, float]:
    """The quickest of some imports, ms on the wall and of processor time; files are cached then."""
    walls, processors = [], []
    for _ in range(tries):
        done = subprocess.run(
            [sys.executable, "-c", _IMPORT, module],
            check=True,
            capture_output=True,
            text=True,
            cwd=ROOT,
        )
        wall, processor = map(float, done.stdout.split()[-2:])
        walls.append(wall)
        processors.append(processor)
    return {"wall_ms": _ms(min(walls)), "processor_ms": _ms(min(processors))}


def help_ms(tries: int = _TRIES) -> dict[str, float]:
    """`metanerf --help` as a whole, from the start of its process to its end."""
    command = [sys.executable, "-m", "services.cli", "--help"]
    walls, processors = [], []
    for _ in range(tries):
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=ROOT)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            raise RuntimeError(f"`metanerf --help` must work; got code {process.returncode}")
        walls.append(time.perf_counter() - began)
        processors.append(used.ru_utime + used.ru_stime)
    return {"wall_ms": _ms(min(walls)), "processor_ms": _ms(min(processors))}


def first_answer() -> dict[str, Any]:
    """The demo's server: s until it answers, in an empty folder and in one that it knows."""
    with tempfile.TemporaryDirectory() as folder:
        new, known = (_answered(Path(folder) / "data") for _ in range(2))
    return {"new_folder_s": new[0], "known_folder_s": known[0], "resident_mb": known[1]}


def _answered(folder: Path) -> tuple[float, float]:
    began = time.perf_counter()
    with running_demo(folder) as address:
        while not _is_up(f"{address}healthz"):
            time.sleep(0.01)
        seconds = time.perf_counter() - began
        return round(seconds, 2), round(metric(address, RESIDENT) / 1e6, 1)


def _is_up(address: str) -> bool:
    try:
        return httpx.get(address, timeout=10).is_success
    except httpx.TransportError:
        return False


def _ms(seconds: float) -> float:
    return round(1e3 * seconds, 1)
