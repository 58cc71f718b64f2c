"""A real service in a process of its own, and what it tells of itself."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

BUSY = "process_cpu_seconds_total"
"""The service's own metric of the processor time it has used."""
RESIDENT = "process_resident_memory_bytes"
"""The service's own metric of its memory."""


@contextmanager
def running_demo(data_dir: Path, **environment: str) -> Iterator[str]:
    """`metanerf demo` on a free port; yields its address."""
    metanerf = [sys.executable, "-c", "from services.cli import main; main()"]
    process = subprocess.Popen(
        [*metanerf, "demo", "--no-browser", "--port", "0", "--data-dir", str(data_dir)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, **environment},
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"http://\S+:\d+/", line):
                yield found[0]
                break
        else:
            raise RuntimeError(f"the demo ended with code {process.wait()}")
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()


def metric(address: str, name: str) -> float:
    """One figure of the service at `address`."""
    page = urllib.request.urlopen(f"{address}metrics", timeout=10).read().decode()
    found = re.search(rf"^{name} (\S+)", page, re.M)
    if found is None:
        raise RuntimeError(f"the service must tell {name}; got a page without it")
    return float(found[1])
