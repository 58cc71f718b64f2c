"""How benchmarks count seconds."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]


def test_the_wall_clock_takes_no_more_threads_than_are_allowed():
    told = "from benchmarks.reporting.timing import clock_named; print(clock_named('wall').threads)"
    asked = subprocess.run(
        [sys.executable, "-c", told],
        cwd=ROOT,
        env={**os.environ, "NUMBA_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert asked.stdout.strip() == "1", asked.stderr
