"""Time a page takes to detect landmarks in a webcam's picture: MediaPipe in its worker.

A headless Chromium without a graphics card, whose camera shows a clip, is seen in the demo's
meeting; the worker times itself from a picture's coming to the landmarks' going. Channel, solver
and drawing are not in it: those are in the meeting's latency. Where the server has the models of
faces and hands (METANERF_FACE_MODEL, METANERF_HAND_MODEL, or a network to fetch them), the page's
other worker looks at these meanwhile; its looks are counted and timed beside.
"""

from __future__ import annotations

import os
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
from playwright.sync_api import Page, Worker, expect

from benchmarks.browser import open_page, running_demo
from benchmarks.reporting.timing import milliseconds

CAMERA = (640, 480)
"""px: what the page asks of a camera."""
WINDOW_PX, SIZE_PX = 512, 128
"""Of the window's sides, and of the meeting's picture, which the same processor draws."""
_RATE_HZ = 30
_WATCHED_S = 15.0
_AT_WORST_MS = 120_000
_WORKER = "/worker-"
"""In the address of the built worker that finds landmarks."""
_EXPRESSION_WORKER = "/expressionWorker-"
_STARTED_MS = 8000.0
"""Until the other worker has opened its models."""
_TIME_ITSELF = """() => {
  const look = self.onmessage;
  self.times = [];
  self.faces = 0;
  self.onmessage = async (event) => {
    const startMs = performance.now();
    await look(event);
    self.times.push(performance.now() - startMs);
    if (event.data.part === 'face') self.faces += 1;
  };
}"""


def write_webcam_video(clip: Path, out: Path, first: int = 0, last: int | None = None) -> Path:
    """Frames of a clip, `first` until `last`, as Motion JPEG: Chromium takes it for a camera."""
    with av.open(str(clip)) as source, av.open(str(out), "w", format="mjpeg") as video:
        stream = video.add_stream("mjpeg", rate=_RATE_HZ)
        (stream.width, stream.height), stream.pix_fmt = CAMERA, "yuvj420p"
        for number, frame in enumerate(source.decode(video=0)):
            if number >= first and (last is None or number < last):
                frame.pts, frame.time_base = number - first, Fraction(1, _RATE_HZ)
                video.mux(stream.encode(frame))
        video.mux(stream.encode())
    return out


def measured(clip: Path, pose_model: Path, watched_s: float = _WATCHED_S) -> dict[str, Any]:
    """p50 and p95 of the worker's time a picture, ms, and pictures a second."""
    model = {"METANERF_POSE_MODEL": str(pose_model)}
    with tempfile.TemporaryDirectory() as folder:
        camera = write_webcam_video(clip, Path(folder) / "webcam.mjpeg")
        with (
            running_demo(Path(folder) / "data", **model) as address,
            open_page(WINDOW_PX, WINDOW_PX, camera) as page,
        ):
            worker = start_tracking(page, address)
            page.wait_for_timeout(_STARTED_MS)
            beside = [one for one in page.workers if _EXPRESSION_WORKER in one.url]
            times, *looks = worker_times([worker, *beside], page, watched_s)
            faces = [one.evaluate("() => self.faces") for one in beside]
    if not times:
        raise RuntimeError(f"landmarks must be found within {watched_s} s; got none")
    looked = [
        {
            **_milliseconds(one),
            "looks_per_second": round(len(one) / watched_s, 1),
            "faces_per_second": round(count / watched_s, 1),
        }
        for one, count in zip(looks, faces, strict=True)
        if one
    ]
    figures = {
        "clip": clip.name,
        "camera": CAMERA,
        "meeting_px": SIZE_PX,
        "pictures": len(times),
        "pictures_per_second": round(len(times) / watched_s, 1),
        **_milliseconds(times),
        "face_and_hands": looked[0] if looked else None,
        "load": round(os.getloadavg()[0], 1),
    }
    print(figures, flush=True)
    return figures


def start_tracking(page: Page, address: str) -> Worker:
    """Start body tracking of `page` in the demo's meeting; returns the landmark worker."""
    page.goto(f"{address}?size={SIZE_PX}")
    page.get_by_test_id("start-join").click(timeout=_AT_WORST_MS)
    with page.expect_worker(lambda one: _WORKER in one.url, timeout=_AT_WORST_MS) as starting:
        page.get_by_test_id("motion-capture").click()
    tracking = page.get_by_test_id("self")
    expect(tracking).to_have_attribute("data-tracking", "tracking", timeout=_AT_WORST_MS)
    return starting.value


def worker_times(workers: list[Worker], page: Page, watched_s: float) -> list[list[float]]:
    """Times a picture of each worker within so many seconds, ms."""
    for worker in workers:
        worker.evaluate(_TIME_ITSELF)
    page.wait_for_timeout(1e3 * watched_s)
    return [worker.evaluate("() => self.times") for worker in workers]


def _milliseconds(times_ms: list[float]) -> dict[str, float]:
    return milliseconds([1e-3 * one for one in times_ms])
