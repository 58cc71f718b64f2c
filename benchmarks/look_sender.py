"""What live look costs its sender's page, in processor time.

What the browser takes with it on and off, in turns, while it finds landmarks of what its camera
shows. With it on the page finds fewer, so what finding takes is counted by the landmarks found. The
process that draws the page is left out: where no graphics card does, it takes what others leave.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from playwright.sync_api import Page

from benchmarks.browser import BUSY, metric, open_page, processor_seconds, running_demo
from benchmarks.landmark_finder import write_webcam_video
from benchmarks.meeting import AT_WORST_MS, prepare_meeting

MUST_CORES, AIM_CORES = 0.25, 0.12
"""Beside finding landmarks."""
_TURNS, _TURN_S, _SETTLED_MS = 3, 12.0, 2000
_STARTED_MS = 8000
"""Until the page has opened all its networks."""
_DRAWS = "--type=gpu-process"
"""In the command line of the browser's process that draws."""
_COUNTED = """
window.landmarks = 0;
const sendAny = RTCDataChannel.prototype.send;
RTCDataChannel.prototype.send = function (data) {
  if (this.label === "motion" && data instanceof ArrayBuffer) landmarks += 1;
  return sendAny.call(this, data);
};
document.addEventListener("change", () => {
  window.changedMs = performance.timeOrigin + performance.now();
}, true);
"""
"""`landmarks`: how many went out; `changedMs`: when a switch was last used, ms since 1970."""


@dataclass(frozen=True, eq=False)
class SendingPage:
    """A page whose person moves by its webcam, in a meeting of a service of its own."""

    page: Page
    service: str
    """Its address."""
    meeting: str
    """Address by which its owner comes into the meeting."""

    def switch(self, on: bool) -> None:
        """Have live look on, or off."""
        self.page.get_by_test_id("live-look").set_checked(on)


@contextmanager
def sending_page(clip: Path) -> Iterator[SendingPage]:
    """A page whose camera shows `clip`, once its person is followed."""
    with tempfile.TemporaryDirectory() as folder:
        camera = write_webcam_video(clip, Path(folder) / "webcam.mjpeg")
        meeting_id, token, _ = prepare_meeting(Path(folder), 1)
        with running_demo(Path(folder)) as service, open_page(webcam=camera) as page:
            page.set_default_timeout(AT_WORST_MS)
            page.add_init_script(_COUNTED)
            meeting = f"{service}?meeting={meeting_id}&size=128#token={token}"
            page.goto(meeting)
            page.get_by_test_id("start-join").click()
            page.get_by_test_id("motion-capture").click()
            page.wait_for_selector("[data-testid=self][data-tracking=tracking]")
            yield SendingPage(page, service, meeting)


def sender(sending: SendingPage) -> dict[str, float]:
    """Cores that the browser takes for finding landmarks and for live look; landmarks a second."""
    turns: dict[bool, list[tuple[float, float, float]]] = {False: [], True: []}
    sending.page.wait_for_timeout(_STARTED_MS)
    for _ in range(_TURNS):
        for on in turns:
            sending.switch(on)
            sending.page.wait_for_timeout(_SETTLED_MS)
            turns[on].append(_turn(sending))
    without, live = (np.sum(turns[on], axis=0) for on in (False, True))
    a_landmark_s = without[0] / max(without[1], 1.0)
    return {
        "landmarks_per_second": round(float(without[1] / without[2]), 1),
        "with_live_look": round(float(live[1] / live[2]), 1),
        "cores_finding_landmarks": round(float(without[0] / without[2]), 2),
        "cores_for_live_look": round(float((live[0] - a_landmark_s * live[1]) / live[2]), 2),
    }


def _turn(sending: SendingPage) -> tuple[float, float, float]:
    """Processor seconds of the browser but for its drawing, landmarks, and seconds."""
    page, address = sending.page, sending.service
    spent, found, begun = _browser_s(address), page.evaluate("landmarks"), time.perf_counter()
    page.wait_for_timeout(1e3 * _TURN_S)
    took = time.perf_counter() - begun
    return _browser_s(address) - spent, page.evaluate("landmarks") - found, took


def _browser_s(address: str) -> float:
    return processor_seconds() - processor_seconds(_DRAWS) - metric(address, BUSY)
