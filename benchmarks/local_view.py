"""What a picture that the page draws by itself costs, in a browser without a graphics card.

Processor seconds of all the browser's processes a picture: they hold on a machine that others use
as well, where pictures a second don't. Poses and viewpoint are new for each picture.
First picture: from the moment at which a page asks for the model's file, over a line of `LINES`, to
the first finished picture of it, shaders and the choice of how many splats to draw included.
"""

from __future__ import annotations

import base64
import functools
import http.server
import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

from playwright.sync_api import Page

from benchmarks.browser import open_page, processor_seconds
from benchmarks.reporting.figures import FigureWriter
from benchmarks.serve import surface_model
from renderer.splats.files.viewer_file import encode
from renderer.splats.model import SplatModel
from renderer.splats.settings import SplatSettings
from services.api.gzipped import ENCODED, gzipped
from services.live.room import MeetingPerformer, Room
from services.live.streaming.pose_feed import pose_packets

SIZES = (256, 512)
COUNTS = (5_000, 10_000, 20_000, 40_000)
MOST_SPLATS = SplatSettings().most
LINES: tuple[tuple[str, float | None], ...] = (("this machine", None), ("10 Mbit/s", 10e6 / 8))
"""Bytes a second."""
_ROOT = Path(__file__).parents[1]
_MOMENTS, _RATE_HZ = 30, 30.0
_SECONDS = 8.0
_JOINS = 5
_PIECE_BYTES = 16_384


def run(writer: FigureWriter) -> None:
    """Measure and report."""
    with measuring_page() as page:
        rows = [_drawn(page, count, size) for count, size in product(COUNTS, SIZES)]
    model = surface_model(MOST_SPLATS)
    file = encode(model)
    first = [_first_picture(model, file, name, rate) for name, rate in LINES]
    sizes = {"splats": len(model), "bytes": len(file), "sent_bytes": len(_compressed(file))}
    writer.write({"people": 1, "drawn": rows, "first_picture": first, "file": sizes})


def _drawn(page: Page, count: int, size: int) -> dict[str, Any]:
    """Pictures for some seconds; the time to make the shaders ready is spread over them."""
    model = surface_model(count)
    asked = {
        "file": encoded_text(encode(model)),
        "moments": [[encoded_text(one) for one in m] for m in _moments_of(model)],
        "size": size,
        "seconds": _SECONDS,
    }
    busy_s = -processor_seconds()
    pictures = int(page.evaluate("asked => window.measure(asked)", asked))
    busy_s += processor_seconds()
    row = {
        "splats": count,
        "size": size,
        "pictures_per_second": round(pictures / _SECONDS, 1),
        "processor_ms": round(1e3 * busy_s / pictures, 1),
    }
    print(row, flush=True)
    return row


def _first_picture(model: SplatModel, file: bytes, line: str, rate: float | None) -> dict[str, Any]:
    """Of a fresh browser each time: one that has drawn before has its shaders ready."""
    moments = [[encoded_text(one) for one in m] for m in _moments_of(model)]
    took_ms = []
    for _ in range(_JOINS):
        with measuring_page(_compressed(file), rate) as page:
            call = "([moments, size]) => window.firstPicture('0', moments, size)"
            took_ms.append(float(page.evaluate(call, [moments, max(SIZES)])))
    row = {
        "splats": len(model),
        "line": line,
        "least_ms": round(min(took_ms)),
        "median_ms": round(statistics.median(took_ms)),
    }
    print(row, flush=True)
    return row


def _moments_of(model: SplatModel) -> list[list[bytes]]:
    """Pose packets of a second of the model's motion."""
    room = _room_of(model)
    return [pose_packets(room, moment / _RATE_HZ, moment + 1) for moment in range(_MOMENTS)]


def _compressed(file: bytes) -> bytes:
    """As a service sends it."""
    return b"".join(gzipped(iter([file])))


def _room_of(model: SplatModel) -> Room:
    return Room("local-view", (MeetingPerformer.at_place("0", "0", model, 0),))


def encoded_text(data: bytes) -> str:
    """Bytes as a page is told them."""
    return base64.b64encode(data).decode()


class _Line(http.server.SimpleHTTPRequestHandler):
    """The page's files, and one model's file at so many bytes a second."""

    def __init__(self, *given: Any, file: bytes, rate: float | None, directory: str) -> None:
        self._file, self._rate = file, rate
        super().__init__(*given, directory=directory)

    def do_GET(self) -> None:
        """The model's file, whichever is asked for; else a file of the page."""
        if not self.path.endswith("viewer.splats"):
            return super().do_GET()
        self.send_response(200)
        self.send_header("Content-Length", str(len(self._file)))
        for name, value in ENCODED.items():
            self.send_header(name, value)
        self.end_headers()
        started = time.perf_counter()
        for sent in range(0, len(self._file), _PIECE_BYTES):
            if self._rate is not None:
                due = started + sent / self._rate
                time.sleep(max(0.0, due - time.perf_counter()))
            try:
                self.wfile.write(self._file[sent : sent + _PIECE_BYTES])
            except OSError:  # the page has seen enough, and is closed
                return None
        return None

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@contextmanager
def measuring_page(file: bytes = b"", rate: float | None = None) -> Iterator[Page]:
    """A page with the client's own modules, built as it is, and a model's compressed `file`."""
    with tempfile.TemporaryDirectory() as out:
        source = Path(__file__).parent / "local_view_page"
        build = ["npx", "vite", "build", str(source), "--outDir", out, "--logLevel", "warn"]
        subprocess.run([*build, "--emptyOutDir"], cwd=_ROOT / "client", check=True)
        handler = functools.partial(_Line, file=file, rate=rate, directory=out)
        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            with open_page(max(SIZES), max(SIZES)) as page:
                page.goto(f"http://127.0.0.1:{server.server_port}/")
                page.wait_for_function("() => 'measure' in window")
                yield page
            server.shutdown()
