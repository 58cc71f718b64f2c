"""What a live view costs: pose and camera to picture, then all the way into a browser.

Drawn: float RGBA by one renderer of all performers, p50 and p95, transforms made anew each frame,
batch 1, no cache. Served: the demo's own service and a headless Chromium's pages, each a viewer.
"""

from __future__ import annotations

import re
import resource
import tempfile
import time
import urllib.request
from itertools import product
from pathlib import Path
from typing import Any

import numba
import numpy as np

from benchmarks.report import milliseconds, write_report
from capture.studio.moves import turning
from capture.studio.performer import make_performer
from renderer.splats.compose import SplatRenderer
from renderer.splats.initialise import sample_surface
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, ROTATION
from renderer.splats.model import SplatModel
from scene.arrays import Array
from scene.camera import orbit_camera

SIZES = (256, 512, 1024)
COUNTS = (5_000, 10_000, 20_000, 50_000)
PERFORMERS = (1, 2, 4, 8)
VIEWERS = ((1, 512), (3, 512), (1, 1024))
"""How many watch, and how many pixels a side."""
_VIEWS, _WARM_UPS = 100, 10
_FRAMES_OF_ONE_SESSION = 10_000
_BESIDE_M = 0.8
_SETTLING_MS, _WATCHED_S = 4000, 8.0


def run(json_file: Path | None) -> None:
    """Measure and report."""
    figures: dict[str, Any] = {"batch": 1, "threads": numba.get_num_threads()}
    figures["drawn"] = [
        _drawn(count, performers, size)
        for count, performers, size in product(COUNTS, PERFORMERS, SIZES)
    ]
    figures["session"] = _long_session()
    figures["served"] = [_served(viewers, size) for viewers, size in VIEWERS]
    write_report(json_file, "serve", figures)


def _drawn(count: int, performers: int, size: int) -> dict[str, Any]:
    """One view after the other round `performers` who stand side by side."""
    cast = _Cast(count, performers)
    seconds = []
    for view in range(-_WARM_UPS, _VIEWS):
        started = time.perf_counter()
        cast.draw(view, size)
        if view >= 0:
            seconds.append(time.perf_counter() - started)
    row = {"splats": count, "performers": performers, "size": size, **milliseconds(seconds)}
    print(row, flush=True)
    return row


class _Cast:
    """Performers side by side, and a camera that goes round them."""

    def __init__(self, count: int, performers: int) -> None:
        self._model = surface_model(count)
        self._renderer = SplatRenderer((self._model,) * performers)
        self._places = _BESIDE_M * (np.arange(performers) - 0.5 * (performers - 1))
        self._distance_m = 3.2 + 0.7 * _BESIDE_M * (performers - 1)

    def draw(self, view: int, size: int) -> Array:
        """The picture number `view`."""
        model = self._model
        camera = orbit_camera((0.0, 0.9, 0.0), self._distance_m, 0.05 * view, 0.05, size, size)
        transforms = []
        for number, across in enumerate(self._places):
            pose = model.motion.pose((view + 7 * number) % len(model.motion))
            moved = pose.root_translation + np.array([across, 0.0, 0.0])
            transforms.append(model.skeleton.skinning_transforms(pose.joint_angles, moved))
        return self._renderer.render(camera, transforms)


def _long_session() -> dict[str, Any]:
    """Peak memory of this process before and after many frames of one session, MiB."""
    cast, peaks = _Cast(10_000, 1), []
    for frames in (_FRAMES_OF_ONE_SESSION // 10, _FRAMES_OF_ONE_SESSION):
        for view in range(frames):
            cast.draw(view, SIZES[0])
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    return {"frames": _FRAMES_OF_ONE_SESSION, "grown_mib": round(peaks[1] - peaks[0], 1)}


def _served(viewers: int, size: int) -> dict[str, Any]:
    """Frames a second that each of `viewers` pages decodes from one meeting, and what they cost."""
    from benchmarks.browser import frames_shown, open_page, running_demo

    with (
        tempfile.TemporaryDirectory() as folder,
        running_demo(Path(folder)) as address,
        open_page(size, size) as first,
    ):
        pages = [first]
        for _ in range(viewers - 1):
            assert first.context.browser is not None
            pages.append(first.context.browser.new_page(viewport={"width": size, "height": size}))
        for page in pages:
            page.goto(f"{address}?size={size}")
            page.get_by_test_id("start-join").click()
            page.wait_for_selector("[data-testid=stage-video]")
        first.wait_for_timeout(_SETTLING_MS)  # the encoder and the browser settle
        shown, busy_s = [-frames_shown(page) for page in pages], -_metric(address, _BUSY)
        started = time.perf_counter()
        first.wait_for_timeout(1e3 * _WATCHED_S)
        watched_s = time.perf_counter() - started
        shown = [before + frames_shown(page) for before, page in zip(shown, pages, strict=True)]
        busy_s += _metric(address, _BUSY)
        row = {
            "viewers": viewers, "size": size,
            "frames_per_second": [round(count / watched_s, 1) for count in shown],
            "render_p50_ms": round(_metric(address, "metanerf_render_milliseconds"), 2),
            "server_cores": round(busy_s / watched_s, 2),
        }  # fmt: skip
    print(row, flush=True)
    return row


_BUSY = "process_cpu_seconds_total"


def _metric(address: str, name: str) -> float:
    page = urllib.request.urlopen(f"{address}metrics", timeout=10).read().decode()
    found = re.search(rf"^{name} (\S+)", page, re.M)
    if found is None:
        raise RuntimeError(f"the service must tell {name}; got a page without it")
    return float(found[1])


def surface_model(count: int) -> SplatModel:
    """Splats on a studio performer's body, as training begins with them."""
    rng, body = np.random.default_rng(0), make_performer(0).body
    points, _, weights, area = sample_surface(body, count, rng)
    parameters = np.zeros((count, PARAMETERS), np.float32)
    parameters[:, :3] = points
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(0.6 * np.sqrt(area / count))
    parameters[:, ROTATION], parameters[:, OPACITY] = 1.0, 2.0
    parameters[:, COLOUR : COLOUR + 3] = rng.uniform(size=(count, 3))
    joints = np.argsort(-weights, axis=1)[:, :4].astype(np.uint8)
    top = np.take_along_axis(weights, joints.astype(int), axis=1).astype(np.float32)
    motion = turning(60, 30.0, 360.0)
    return SplatModel(
        parameters, joints, top, np.ones(count, bool), body.skeleton, motion, "benchmark"
    )
