"""What a second is: on a quiet machine the clock on the wall, on a busy one the processor's time.

`wall` uses every core. `processor` computes on one thread and counts the time that the process was
running, whichever of its threads that was (a field's steps run on a pool's): what a neighbour does,
or a thread that waits for work, changes little, and a machine with more cores would be no slower.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch


@dataclass(frozen=True)
class Clock:
    """How seconds are counted, and on how many threads."""

    name: str
    now: Callable[[], float]
    threads: int

    def about(self) -> dict[str, Any]:
        """For the record."""
        return {"clock": self.name, "threads": self.threads}


def clock_named(name: str) -> Clock:
    """The clock `wall` or `processor`; from now on this process computes on as many threads."""
    import numba

    one = name == "processor"
    cores = len(os.sched_getaffinity(0))
    threads = 1 if one else min(cores, int(os.environ.get("NUMBA_NUM_THREADS", cores)))
    torch.set_num_threads(threads)
    numba.set_num_threads(threads)
    return Clock(name, time.process_time if one else time.perf_counter, threads)


def milliseconds(seconds: list[float]) -> dict[str, float]:
    """p50 and p95, ms."""
    return {f"p{q}_ms": round(float(np.percentile(seconds, q)) * 1e3, 3) for q in (50, 95)}


def late_share(seconds: list[float]) -> dict[str, float]:
    """Share of those that took more than twice the median."""
    taken = np.array(seconds)
    return {"over_twice_p50": round(float((taken > 2.0 * np.median(taken)).mean()), 4)}
