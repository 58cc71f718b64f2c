"""Two pages record some seconds, and one of them sees itself again from another side."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page, running_demo
from tests.e2e.test_control import beside, come
from tests.services.jobs.waiting import until

pytestmark = pytest.mark.e2e
MINUTE = 60_000
RUNNING = re.compile(r"^\s*Recording\s*$")
"""What the page says while all that happens is kept."""
_PICTURE = """() => {
    const canvas = document.querySelector('[data-testid=replay]');
    const small = document.createElement('canvas');
    small.width = small.height = 64;
    const brush = small.getContext('2d');
    brush.drawImage(canvas, 0, 0, 64, 64);
    return [...brush.getImageData(0, 0, 64, 64).data];
}"""
KEEP_PICTURES = (
    "HTMLCanvasElement.prototype.getContext = (get => function (kind, options) {"
    " return get.call(this, kind, { ...options, preserveDrawingBuffer: true }); })"
    "(HTMLCanvasElement.prototype.getContext)"
)


def shown(page: Page, frames: int) -> list[int]:
    """Pixels of the replay, once so many pictures were drawn."""
    page.wait_for_function(
        "() => Number(document.querySelector('[data-testid=replay]')?.dataset.frames ?? 0)"
        f" >= {frames}",
        timeout=MINUTE,
    )
    return page.evaluate(_PICTURE)


def difference(one: list[int], other: list[int]) -> float:
    return sum(abs(a - b) for a, b in zip(one, other, strict=True)) / len(one)


def test_a_meeting_is_recorded_and_seen_again_from_another_side(tmp_path):
    with running_demo(tmp_path / "data") as address, open_page() as ada, beside(ada) as bo:
        come(ada, address, "Ada")
        expect(ada.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        come(bo, address, "Bo")
        expect(bo.get_by_test_id("live-video")).to_be_visible(timeout=MINUTE)
        expect(bo.get_by_test_id("record")).to_be_hidden()
        ada.get_by_test_id("record").click()
        expect(bo.get_by_test_id("recording")).to_contain_text("The host asks to record")
        expect(ada.get_by_test_id("recording")).to_contain_text("once everybody agrees")
        bo.get_by_test_id("recording-agree").click()
        expect(ada.get_by_test_id("recording")).to_have_text(RUNNING, timeout=MINUTE)
        # some seconds of the recording: told by what is kept, not by a clock
        token = ada.evaluate(
            "localStorage.getItem('metanerf.token') ?? sessionStorage.getItem('metanerf.token')"
        )
        header = {"Authorization": f"Bearer {token}"}
        listing = ada.request.get(f"{address}v1/recordings", headers=header).json()
        recording = listing["items"][0]["id"]
        place = f"{address}v1/recordings/{recording}"
        for _ in range(300):
            if ada.request.get(place, headers=header).json()["duration_s"] >= 5.0:
                break
            ada.wait_for_timeout(200)
        # anybody may have it end
        bo.get_by_test_id("recording-refuse").click()
        expect(ada.get_by_test_id("recording")).to_contain_text("The recording has ended")
        ada.add_init_script(KEEP_PICTURES)
        ada.goto(f"{address}?recording={recording}")
        start = shown(ada, 1)
        assert max(start) - min(start) > 60  # somebody stands there
        ada.get_by_test_id("replay-play").click()
        expect(ada.get_by_test_id("replay-clock")).to_contain_text("0:02 / ", timeout=MINUTE)
        ada.get_by_test_id("replay-play").click()
        moved = shown(ada, 2)
        assert difference(start, moved) > 0.2
        ada.get_by_role("main").focus()
        ada.keyboard.down("KeyE")
        # seen from the other side as much as 5 to 6 differs, with the moment; the same view has nil
        until(lambda: difference(moved, shown(ada, 2)) > 2.0, "another viewpoint")
        ada.keyboard.up("KeyE")
        ada.goto(f"{address}?recordings")
        expect(ada.get_by_test_id("recordings").get_by_role("link")).to_have_count(1)
        # who was not there sees nothing of it
        with beside(ada) as stranger:
            stranger.goto(f"{address}?recording={recording}")
            expect(stranger.get_by_test_id("error")).to_be_visible(timeout=MINUTE)
