"""Frames a second that a headless Chromium decodes from the demo's meeting."""

from __future__ import annotations

import re
import tempfile
import urllib.request
from pathlib import Path

from benchmarks.browser import frames_shown, open_page, running_demo
from benchmarks.report import write_report


def run(json_file: Path | None, size: int, seconds: float) -> None:
    """Start the demo, join it in a browser, watch for `seconds`, report."""
    with (
        tempfile.TemporaryDirectory() as folder,
        running_demo(Path(folder)) as address,
        open_page(size, size) as page,
    ):
        page.goto(f"{address}?size={size}")
        page.get_by_test_id("start-join").click()
        page.wait_for_selector("[data-testid=stage-video]")
        page.wait_for_timeout(4000)  # the encoder and the browser settle
        before = frames_shown(page)
        page.wait_for_timeout(seconds * 1000)
        shown = frames_shown(page) - before
        video = page.evaluate(
            "() => { const v = document.querySelector('[data-testid=stage-video]');"
            " return [v.videoWidth, v.videoHeight]; }"
        )
        metrics = urllib.request.urlopen(f"{address}metrics", timeout=10).read().decode()
    render = re.search(r"^metanerf_render_milliseconds (\S+)", metrics, re.M)
    write_report(
        json_file,
        "live",
        {
            "viewers": 1,
            "video": video,
            "frames_per_second": round(shown / seconds, 1),
            "render_p50_ms": round(float(render[1]), 2) if render else None,
        },
    )
