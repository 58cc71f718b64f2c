"""A meeting drawn by the viewer's own device: switched live, the server resting, nothing twice."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page, running_demo
from tests.e2e.test_meeting import MINUTES, watch

pytestmark = pytest.mark.e2e

_FILE = "/files/viewer.splats"


def decoded(page: Page) -> int:
    """Pictures of the server's that the browser has decoded."""
    return page.evaluate(
        "() => document.querySelector('[data-testid=live-video]')"
        ".getVideoPlaybackQuality().totalVideoFrames"
    )


def server_rests(page: Page) -> bool:
    """Whether no more pictures come; at first some are on their way."""
    for _ in range(4):
        before = decoded(page)
        watch(page, 15)
        if decoded(page) == before:
            return True
    return False


def fetched(page: Page) -> list[tuple[int, int]]:
    """Bytes over the network and bytes in all, of each file of splats that the page asked for."""
    return page.evaluate(
        "name => performance.getEntriesByType('resource').filter(e => e.name.endsWith(name))"
        ".map(e => [e.transferSize, e.decodedBodySize])",
        _FILE,
    )


def seen(page: Page) -> np.ndarray:
    """What the middle of the viewport shows."""
    shot = page.screenshot(clip={"x": 312, "y": 150, "width": 400, "height": 400})
    png = np.frombuffer(shot, np.uint8)
    picture = cv2.imdecode(png, cv2.IMREAD_COLOR)
    assert picture is not None
    return picture.astype(float)


def draw_here(page: Page) -> None:
    watch(page, 5)
    page.get_by_test_id("render-mode").select_option("local")
    expect(page.locator(".viewport > canvas.shown")).to_be_visible(timeout=MINUTES)
    expect(page.get_by_test_id("render-mode")).to_have_attribute("data-mode", "local")


def test_a_viewer_draws_for_themselves_and_lets_the_server_draw_again(tmp_path):
    with running_demo(tmp_path / "data") as address, open_page() as page:
        page.goto(f"{address}?size=256")
        page.get_by_test_id("start-join").click()
        draw_here(page)
        assert server_rests(page)
        still = seen(page)
        page.mouse.move(512, 384)
        page.mouse.wheel(0, -600)
        watch(page, 15)
        assert np.abs(seen(page) - still).mean() > 5.0
        page.get_by_test_id("show-unseen").click()
        watch(page, 5)

        page.get_by_test_id("render-mode").select_option("server")
        expect(page.locator(".viewport > canvas.shown")).to_have_count(0, timeout=MINUTES)
        before = decoded(page)
        watch(page, 15)
        assert decoded(page) > before
        ((sent, whole),) = fetched(page)
        assert 100_000 < sent < whole  # compressed on the way
        page.reload()  # the seat is kept, and whoever comes back downloads nobody again, but asks
        draw_here(page)
        ((asked, again),) = fetched(page)
        assert asked < 1_000
        assert again == whole
