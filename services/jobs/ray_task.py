"""What a node of a Ray cluster does for a job: it runs the same child process as a local worker.

The node shares no disk with anybody: its settings, and with them the addresses and secrets of the
database and the object store, are those of its own environment, and clips, frames, checkpoints and
models go through the store. A process of its own keeps torch out of Ray's workers, gives all memory
back at its end, and stops by itself once Ray's worker is gone. This module does not import Ray.
"""

from __future__ import annotations

import signal
import time

from services.jobs.local_engine import ChildProcess
from services.settings import load_settings

_POLL_S = 0.2


def run_attempt(job_id: str, attempt: int) -> int:
    """Run one attempt at a job; the exit code of its process.

    Ray cancels a task by an interrupt: the process then has `stop_grace_s` to leave a checkpoint.
    """
    # a cluster that was started in a shell's background ignores interrupts
    signal.signal(signal.SIGINT, signal.default_int_handler)
    settings = load_settings()
    environment = settings.child_environment()
    if threads := environment.get("OMP_NUM_THREADS"):  # Ray's, by the task's num_cpus
        environment.setdefault("NUMBA_NUM_THREADS", threads)
    child = ChildProcess(job_id, attempt, settings, environment)
    try:
        while (code := child.poll()) is None:
            time.sleep(_POLL_S)
    except KeyboardInterrupt:
        while (code := child.poll()) is None:
            child.stop()
            time.sleep(_POLL_S)
    return code
