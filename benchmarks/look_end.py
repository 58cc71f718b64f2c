"""How soon live look is gone from another page: from the switch on its sender's page to there.

Where that page draws, until its first drawing after which every change of colour is nil. Where the
server draws, until the first of the video's pictures that is shown and nearer to those of seconds
later, in trained colours, than to those from before the switch: a turn in which these two cannot
be told apart counts for nothing. All run on this machine, on one clock.
"""

from __future__ import annotations

import os
import statistics
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from playwright.sync_api import Page

from benchmarks.look_sender import SendingPage
from benchmarks.meeting import AT_WORST_MS, have_the_page_draw

MUST_GONE_MS = 200.0
"""From the switch to the picture."""
WATCH_COLOURS = """
window.colours = [];
let handed = null;
const nowMs = () => performance.timeOrigin + performance.now();
const texImage = WebGL2RenderingContext.prototype.texImage2D;
WebGL2RenderingContext.prototype.texImage2D = function (...args) {
  if (args[2] === this.R32UI && args[3] === 256) handed = args[8].filter(Boolean).length;
  return texImage.apply(this, args);
};
const drawArrays = WebGL2RenderingContext.prototype.drawArrays;
WebGL2RenderingContext.prototype.drawArrays = function (...args) {
  if (handed !== null) colours.push([nowMs(), handed]);
  handed = null;
  return drawArrays.apply(this, args);
};
"""
"""For a page that draws. `colours`: when it drew after it handed changes to the card, ms since
1970, and of how many splats."""
WATCH_PICTURES = """() => {
  const video = document.querySelector('[data-testid=live-video]');
  const pen = new OffscreenCanvas(8, 8).getContext('2d', { willReadFrequently: true });
  window.shown = [];
  const look = () => {
    pen.drawImage(video, 0, 0, 8, 8);
    const levels = [...pen.getImageData(0, 0, 8, 8).data].filter((_, at) => at % 4 < 3);
    shown.push([performance.timeOrigin + performance.now(), levels]);
    video.requestVideoFrameCallback(look);
  };
  video.requestVideoFrameCallback(look);
}"""
"""For a page that shows the server's pictures. `shown`: when each was shown, ms since 1970, and
the levels of 8 x 8 parts of it."""
_TURNS = 7
_LIVE_MS, _SETTLED_MS, _WATCHED_MS = 3000.0, 1200.0, 3000.0
_FEWEST, _OWN_SIDE, _IN_A_ROW = 5, 0.95, 3
_Turn = Callable[[SendingPage, Page], float | None]


def gone(sending: SendingPage) -> list[dict[str, Any]]:
    """Milliseconds where the page draws, then where the server does; live look is off at last."""
    ways: tuple[tuple[str, Callable[[Page], None], _Turn], ...] = (
        ("page", have_the_page_draw, _page_turn),
        ("server", _server_draws, _server_turn),
    )
    rows = []
    for drawn_by, prepare, turn in ways:
        with _viewer(sending) as viewer:
            prepare(viewer)
            took = [turn(sending, viewer) for _ in range(_TURNS)]
        known = [one for one in took if one is not None]
        row = {
            "drawn_by": drawn_by,
            "turns": _TURNS,
            "told": len(known),
            "median_ms": round(statistics.median(known)) if known else None,
            "worst_ms": round(max(known)) if known else None,
            "load": round(os.getloadavg()[0], 1),
        }
        print(row, flush=True)
        rows.append(row)
    return rows


@contextmanager
def _viewer(sending: SendingPage) -> Iterator[Page]:
    browser = sending.page.context.browser
    assert browser is not None
    viewer = browser.new_page(viewport={"width": 512, "height": 512})
    viewer.set_default_timeout(AT_WORST_MS)
    viewer.add_init_script(WATCH_COLOURS)
    viewer.goto(sending.meeting)
    viewer.get_by_test_id("start-join").click()
    viewer.wait_for_selector("[data-testid=live-video]")
    yield viewer
    viewer.close()


def _server_draws(viewer: Page) -> None:
    viewer.get_by_test_id("render-mode").select_option("server")
    viewer.evaluate(WATCH_PICTURES)


def _page_turn(sending: SendingPage, viewer: Page) -> float | None:
    """ms; None where it ended before, as no picture came for a second."""
    viewer.evaluate("colours = []")
    sending.switch(True)
    viewer.wait_for_function("() => colours.some(([, splats]) => splats > 0)")
    viewer.wait_for_timeout(_LIVE_MS)
    sending.switch(False)
    viewer.wait_for_function("() => colours.at(-1)[1] === 0")
    took = viewer.evaluate("colours.at(-1)[0]") - sending.page.evaluate("changedMs")
    return took if took > 0.0 else None


def _server_turn(sending: SendingPage, viewer: Page) -> float | None:
    """ms; None where the pictures tell nothing."""
    sending.switch(True)
    viewer.wait_for_timeout(2.0 * _LIVE_MS)
    viewer.evaluate("shown = []")
    viewer.wait_for_timeout(_LIVE_MS)
    sending.switch(False)
    viewer.wait_for_timeout(_WATCHED_MS)
    return gone_after_ms(viewer.evaluate("shown"), sending.page.evaluate("changedMs"))


def gone_after_ms(shown: list[tuple[float, list[float]]], off_ms: float) -> float | None:
    """From `off_ms` until the first of what was `shown` (when, ms, and levels of its parts) that is
    in trained colours as the next ones are; None where they hardly differ from the live ones."""
    if not shown:
        return None
    times = np.array([time_ms for time_ms, _ in shown]) - off_ms
    levels = np.array([one for _, one in shown], float)
    live, trained = times <= 0.0, times > _SETTLED_MS
    if min(np.count_nonzero(live), np.count_nonzero(trained)) < _FEWEST:
        return None
    # every other picture says how colours differ, the rest whether that tells them apart
    means = [levels[ones][::2].mean(axis=0) for ones in (live, trained)]
    is_trained = (levels - 0.5 * (means[0] + means[1])) @ (means[1] - means[0]) > 0.0
    if min(np.mean(~is_trained[live][1::2]), np.mean(is_trained[trained][1::2])) < _OWN_SIDE:
        return None
    for at in np.flatnonzero(times > 0.0):
        if is_trained[at : at + _IN_A_ROW].all():
            return float(times[at])
    return None
