"""From a webcam's landmarks to the picture on a viewer's screen, through a real meeting.

Every performer's landmarks come over WebRTC; a headless Chromium looks on, at the server's pictures
or at its own. Each shows when the newest landmarks were captured
(services.live.streaming.latency_code); the page reads that from the pixels:
latency is the age of a picture, ms, when it is handed to the screen.
Processor time holds on a machine that others use as well; frames a second and latency do not: each
row says how many processes wanted a core (`load`), and how wide the pictures by the server were.
What a page takes to find the landmarks is measured apart (benchmarks.landmark_finder).
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page

from benchmarks import landmark_finder
from benchmarks.browser import (
    BUSY,
    RESIDENT,
    metric,
    open_page,
    processor_seconds,
    running_demo,
)
from benchmarks.live_people import LivePeople
from benchmarks.reporting.figures import FigureWriter

PERFORMERS = (1, 2, 4, 8)
SIZE_PX = 512
_ACCOUNT = "benchmark"
_SETTLING_MS, _WATCHED_S = 5000, 8.0
AT_WORST_MS = 120_000
TO_POSE = "metanerf_keypoints_to_pose_seconds"
"""The service's own metric of the time from a packet's coming to its pose."""
_COUNTING = """
window.peers = [];
const Peer = RTCPeerConnection;
RTCPeerConnection = class extends Peer { constructor(...all) { super(...all); peers.push(this); } };
"""
_BYTES = """async () => {
  const sum = { up: 0, down: 0 };
  for (const peer of peers) {
    (await peer.getStats()).forEach(entry => {
      if (entry.type !== 'transport') return;
      sum.up += entry.bytesSent; sum.down += entry.bytesReceived;
    });
  }
  return sum;
}"""


_COUNTED = """() => new Promise(tell => {
  const numbers = document.querySelector('[data-testid=fps]');
  const now = () => tell([Number(numbers.dataset.frames ?? 0), performance.now() / 1000]);
  new MutationObserver(now).observe(numbers, { attributeFilter: ['data-frames'] });
  setTimeout(now, 2000); // where nothing comes, nothing changes
})"""
"""Pictures shown so far and when that was noted, s, as the page next notes it: it does so once a
second, and a count read at any other moment is up to 30 pictures old."""


@dataclass(frozen=True)
class OpenMeeting:
    """A meeting of a service that runs."""

    address: str
    meeting_id: str


@dataclass(frozen=True)
class DrivenMeeting(OpenMeeting):
    """A meeting whose performers all move by landmarks."""

    people: LivePeople


def run(writer: FigureWriter, clip: Path, pose_model: Path) -> None:
    """Measure and report; the landmark finder's camera shows `clip`."""
    about, cache = {"size": SIZE_PX, "watched_s": _WATCHED_S}, writer.cache()
    finder = landmark_finder.measured(clip, pose_model)
    rows: list[dict[str, Any]] = []
    for performers in PERFORMERS:
        found = cache.measured(
            f"{performers}-performers", about, lambda p=performers: {"rows": list(_measured(p))}
        )
        rows += [] if found is None else found["rows"]
    writer.write({**about, "rows": rows, "landmark_finder": finder})


def _measured(performers: int) -> Iterator[dict[str, Any]]:
    """One meeting: seen by the server's pictures, by two viewers (of four), by the page's own."""
    with driven(performers) as meeting, open_page(SIZE_PX, SIZE_PX) as page:
        look(page, meeting, SIZE_PX)
        yield {"performers": performers, "drawn_by": "server", **watched(meeting, [page])}
        if performers == 4:
            second = beside(page, meeting, SIZE_PX)
            pages = [page, second]
            yield {"performers": performers, "drawn_by": "server", **watched(meeting, pages)}
            second.close()
        have_the_page_draw(page)
        yield {"performers": performers, "drawn_by": "page", **watched(meeting, [page])}


@contextmanager
def driven(performers: int) -> Iterator[DrivenMeeting]:
    """A service of its own with one meeting, whose performers move."""
    with tempfile.TemporaryDirectory() as folder:
        meeting_id, token, ids = prepare_meeting(Path(folder), performers)
        with running_demo(Path(folder), METANERF_STAMP_PICTURES="1") as address:
            people = LivePeople(address, meeting_id, token, ids)
            with people.moving():
                yield DrivenMeeting(address, meeting_id, people)


def prepare_meeting(folder: Path, performers: int) -> tuple[str, str, list[str]]:
    """A meeting of the demo's person, so many times: its id, its owner's token, the performers."""
    from services.auth import ALL_SCOPES
    from services.bootstrap import DEMO_MODEL, import_model
    from services.composition import build_services
    from services.meetings import create_meeting
    from services.settings import load_settings

    services = build_services(load_settings(data_dir=folder, open_access=True))
    services.database.migrate()
    models = [
        import_model(services, DEMO_MODEL, _ACCOUNT, f"Performer {n + 1}")
        for n in range(performers)
    ]
    with services.unit_of_work() as unit:
        meeting = create_meeting(services, unit, _ACCOUNT, "Benchmark", models)
        meeting_id, ids = meeting.id, [performer.id for performer in meeting.performers]
        unit.commit()
    token, _ = services.tokens.issue(_ACCOUNT, ALL_SCOPES, timedelta(hours=1))
    services.close()
    return meeting_id, token, ids


def beside(page: Page, meeting: DrivenMeeting, size: int, *, stamped: bool = True) -> Page:
    """One more viewer in the same browser, who stands elsewhere: nothing is drawn for both."""
    assert page.context.browser is not None
    other = page.context.browser.new_page(viewport=page.viewport_size)
    look(other, meeting, size, stamped=stamped)
    other.keyboard.press("d", delay=600)
    return other


def look(page: Page, meeting: OpenMeeting, size: int, *, stamped: bool = True) -> None:
    """Have `page` look on, at pictures by the server of `size` px a side, and read their codes
    where `stamped`."""
    page.set_default_timeout(AT_WORST_MS)
    page.add_init_script(_COUNTING)
    stamp = "&stamp" if stamped else ""
    page.goto(f"{meeting.address}?meeting={meeting.meeting_id}&size={size}{stamp}")
    page.get_by_test_id("start-join").click()
    page.wait_for_selector("[data-testid=live-video]")
    page.wait_for_function(
        "() => Number(document.querySelector('[data-testid=fps]')?.dataset.frames) > 5"
    )
    page.get_by_test_id("render-mode").select_option("server")


def have_the_page_draw(page: Page) -> None:
    """In place of the server; returns once its picture is the one that is seen."""
    page.get_by_test_id("render-mode").select_option("local")
    page.wait_for_selector(".viewport > canvas.shown", timeout=AT_WORST_MS)


def watched(meeting: DrivenMeeting, pages: Sequence[Page]) -> dict[str, Any]:
    """What `pages` show for some seconds, and what that costs."""
    pages[0].wait_for_timeout(_SETTLING_MS)
    for page in pages:
        _ages(page)
    counted = [page.evaluate(_COUNTED) for page in pages]
    before = _state(meeting, pages)
    started = time.perf_counter()
    pages[0].wait_for_timeout(1e3 * _WATCHED_S)
    watched_s = time.perf_counter() - started
    ages = [age for page in pages for age in _ages(page)]
    spent = {name: value - before[name] for name, value in _state(meeting, pages).items()}
    rates = [
        _rate(first, page.evaluate(_COUNTED)) for first, page in zip(counted, pages, strict=True)
    ]
    pictures = max(sum(rates) * watched_s, 1.0)
    driven_by = len(meeting.people.performers)
    browser_s = spent["all_s"] - spent["server_s"]
    p50, p95 = (round(float(np.percentile(ages, q))) if ages else None for q in (50, 95))
    figures = {
        "viewers": len(pages),
        "load": round(os.getloadavg()[0], 1),
        "latency_p50_ms": p50,
        "latency_p95_ms": p95,
        "codes_read": len(ages),
        "shown_px": [_width(page) for page in pages],
        "frames_per_second": round(sum(rates) / len(pages), 1),
        "frames_per_second_slowest": round(min(rates), 1),
        "packet_to_pose_ms": round(1e3 * spent["solved_s"] / max(spent["solved"], 1.0), 2),
        "server_cpu_ms_a_picture": round(1e3 * spent["server_s"] / pictures, 1),
        "browser_cpu_ms_a_picture": round(1e3 * browser_s / pictures, 1),
        "server_resident_mib": round(metric(meeting.address, RESIDENT) / 2**20),
        "server_cores_a_viewer": round(spent["server_s"] / len(pages) / watched_s, 2),
        "up_a_performer_mbit_s": round(_mbit(spent["sent"], watched_s) / driven_by, 3),
        "up_a_viewer_mbit_s": round(_mbit(spent["up"], watched_s) / len(pages), 3),
        "down_a_viewer_mbit_s": round(_mbit(spent["down"], watched_s) / len(pages), 3),
    }
    print(figures, flush=True)
    return figures


def _rate(first: tuple[float, float], last: tuple[float, float]) -> float:
    """Pictures a second between two counts."""
    return (last[0] - first[0]) / (last[1] - first[1])


def _mbit(count: float, seconds: float) -> float:
    return 8e-6 * count / seconds


def _state(meeting: DrivenMeeting, pages: Sequence[Page]) -> dict[str, float]:
    """What only grows: processor seconds, poses solved, bytes."""
    moved = [page.evaluate(_BYTES) for page in pages]
    return {
        "server_s": metric(meeting.address, BUSY),
        "solved": metric(meeting.address, f"{TO_POSE}_count"),
        "solved_s": metric(meeting.address, f"{TO_POSE}_sum"),
        "all_s": processor_seconds(),
        "sent": float(meeting.people.bytes_sent),
        "up": float(sum(one["up"] for one in moved)),
        "down": float(sum(one["down"] for one in moved)),
    }


def _width(page: Page) -> int:
    """Of the newest picture by the server, px: a service that can't keep up sends smaller ones."""
    return int(page.get_by_test_id("live-video").evaluate("video => video.videoWidth"))


def _ages(page: Page) -> list[float]:
    """Ages of the pictures shown since the last call, ms."""
    text = page.evaluate(
        """() => {
            const video = document.querySelector('[data-testid=live-video]');
            const ages = video.dataset.latencies ?? '';
            delete video.dataset.latencies;
            return ages;
        }"""
    )
    return [float(age) for age in text.split(",") if age]
