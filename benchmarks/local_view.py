"""What a picture that the page draws by itself costs, in a browser without a graphics card.

Processor seconds of all the browser's processes a picture: they hold on a machine that others use
as well, where pictures a second don't. Poses and viewpoint are new for each picture.
"""

from __future__ import annotations

import base64
import functools
import http.server
import subprocess
import tempfile
import threading
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
from services.live.room import MeetingPerformer, Room, circle_layout, facing_yaw
from services.live.streaming.pose_feed import pose_packets

SIZES = (256, 512)
COUNTS = (5_000, 10_000)
_ROOT = Path(__file__).parents[1]
_MOMENTS, _RATE_HZ = 30, 30.0
_SECONDS = 8.0


def run(writer: FigureWriter) -> None:
    """Measure and report."""
    with _measuring_page() as page:
        rows = [_drawn(page, count, size) for count, size in product(COUNTS, SIZES)]
    writer.write({"people": 1, "drawn": rows})


def _drawn(page: Page, count: int, size: int) -> dict[str, Any]:
    """Pictures for some seconds; the time to make the shaders ready is spread over them."""
    model = surface_model(count)
    room = _room_of(model)
    moments = [pose_packets(room, moment / _RATE_HZ, moment + 1) for moment in range(_MOMENTS)]
    asked = {
        "file": _text(encode(model)),
        "moments": [[_text(one) for one in m] for m in moments],
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


def _room_of(model: SplatModel) -> Room:
    ((place, yaw),) = circle_layout(1)
    yaw += facing_yaw(model.motion)
    return Room("local-view", (MeetingPerformer("0", "0", model, model.motion, place, yaw),))


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


@contextmanager
def _measuring_page() -> Iterator[Page]:
    """A page with the client's own modules, built as it is."""
    with tempfile.TemporaryDirectory() as out:
        source = Path(__file__).parent / "local_view_page"
        build = ["npx", "vite", "build", str(source), "--outDir", out, "--logLevel", "warn"]
        subprocess.run([*build, "--emptyOutDir"], cwd=_ROOT / "client", check=True)
        handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=out)
        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            with open_page(max(SIZES), max(SIZES)) as page:
                page.goto(f"http://127.0.0.1:{server.server_port}/")
                page.wait_for_function("() => 'measure' in window")
                yield page
            server.shutdown()
