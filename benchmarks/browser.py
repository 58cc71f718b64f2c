"""A real headless Chromium."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from pathlib import Path

from playwright.sync_api import ConsoleMessage, Page, Response, sync_playwright

from benchmarks.service import BUSY as BUSY
from benchmarks.service import RESIDENT as RESIDENT
from benchmarks.service import metric as metric
from benchmarks.service import running_demo as running_demo

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
def open_page(
    width: int = 1024, height: int = 768, webcam: Path | None = None, *, any_script: bool = False
) -> Iterator[Page]:
    """A page of a fresh browser, which must not fail (faults_of).

    With `webcam`, a file of Motion JPEG, its camera is allowed and shows that, over and over. With
    `any_script` its security policy does not hold, for one that listens in.
    """
    camera = (
        [] if webcam is None else [*_CAMERA_FLAGS, f"--use-file-for-fake-video-capture={webcam}"]
    )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=[*_FLAGS, *camera])
        page = browser.new_page(viewport={"width": width, "height": height}, bypass_csp=any_script)
        faults = faults_of(page)
        yield page
        browser.close()
        if faults:
            raise RuntimeError(f"the page failed: {faults}")


def faults_of(page: Page) -> list[str]:
    """What goes wrong on `page` from now on: errors of its scripts, what its security policy
    keeps it from, and what it asks a server for that is not there (404)."""
    faults: list[str] = []

    def heed(message: ConsoleMessage) -> None:
        if "Content Security Policy" in message.text:
            faults.append(message.text)

    def answered(response: Response) -> None:
        if response.status == HTTPStatus.NOT_FOUND:
            faults.append(f"{response.request.method} {response.url}: not found")

    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", heed)
    page.on("response", answered)
    return faults


def processor_seconds(told: str = "") -> float:
    """Processor seconds so far of every process that this one has started, and theirs, whose
    command line has `told` in it."""
    parents: dict[int, int] = {}
    ticks: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
            command = (stat.parent / "cmdline").read_text()
        except OSError:  # it has ended meanwhile
            continue
        pid = int(stat.parent.name)
        parents[pid] = int(fields[1])
        ticks[pid] = int(fields[11]) + int(fields[12]) if told in command else 0

    def started_here(pid: int) -> bool:
        while pid in parents and pid != os.getpid():
            pid = parents[pid]
        return pid == os.getpid()

    ours = (pid for pid in ticks if pid != os.getpid() and started_here(pid))
    return sum(ticks[pid] for pid in ours) / os.sysconf("SC_CLK_TCK")
