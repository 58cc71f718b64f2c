"""A real headless Chromium, and a real service in a process of its own."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

BUSY = "process_cpu_seconds_total"
"""The service's own metric of the processor time it has used."""
RESIDENT = "process_resident_memory_bytes"
"""The service's own metric of its memory."""
_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--autoplay-policy=no-user-gesture-required",
]
_CAMERA_FLAGS = ["--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"]
_NAMES = ("chromium", "chromium-browser", "google-chrome")


def chromium() -> str | None:
    """`$CHROMIUM`, else a Chromium on PATH, else None: Playwright's own."""
    return os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, _NAMES)), None)


@contextmanager
def open_page(width: int = 1024, height: int = 768, webcam: Path | None = None) -> Iterator[Page]:
    """A page of a fresh browser; errors of its scripts are raised.

    With `webcam`, a file of Motion JPEG, its camera is allowed and shows that, over and over.
    """
    camera = (
        [] if webcam is None else [*_CAMERA_FLAGS, f"--use-file-for-fake-video-capture={webcam}"]
    )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=[*_FLAGS, *camera])
        page = browser.new_page(viewport={"width": width, "height": height})
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        yield page
        browser.close()
        if faults:
            raise RuntimeError(f"the page failed: {faults}")


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


def processor_seconds() -> float:
    """Processor seconds so far of every process that this one has started, and theirs."""
    parents: dict[int, int] = {}
    ticks: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended meanwhile
            continue
        pid = int(stat.parent.name)
        parents[pid], ticks[pid] = int(fields[1]), int(fields[11]) + int(fields[12])

    def started_here(pid: int) -> bool:
        while pid in parents and pid != os.getpid():
            pid = parents[pid]
        return pid == os.getpid()

    ours = (pid for pid in ticks if pid != os.getpid() and started_here(pid))
    return sum(ticks[pid] for pid in ours) / os.sysconf("SC_CLK_TCK")
