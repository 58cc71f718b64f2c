"""How benchmarks count seconds."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import pytest
import torch

from benchmarks.reporting.timing import clock_named

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


@pytest.fixture
def threads():
    before = torch.get_num_threads(), numba.get_num_threads()
    yield
    torch.set_num_threads(before[0])
    numba.set_num_threads(before[1])


def test_what_a_pool_computes_counts_as_processor_time(threads):
    def busy() -> float:
        began = time.thread_time()
        while time.thread_time() - began < 0.2:
            sum(range(1000))
        return time.thread_time() - began

    clock = clock_named("processor")
    began = clock.now()
    with ThreadPoolExecutor(1) as pool:
        spent_s = pool.submit(busy).result()
    assert clock.now() - began >= 0.99 * spent_s
