"""On a poor network live look is the first to go; motion and sound stay, and it returns by itself.

A network is poor where answers come late, and where the pictures of the meeting give way to sound
alone.
"""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page
from services.gateway import gateway_of
from tests.e2e.late_line import late_line
from tests.e2e.serving import serving
from tests.e2e.slow_line import slow_line
from tests.e2e.test_control import HUM, beside, come
from tests.e2e.test_live_look import OUTGOING_VIDEO, Kept, enter, meeting_of, networks
from tests.e2e.test_motion_capture import webcam
from tests.e2e.test_slow_line import (
    AUDIO_BYTES,
    MINUTE,
    PEERS,
    STARVED_BIT_PER_S,
)
from tests.e2e.viewport import frames_shown
from tests.services.jobs.waiting import until
from tests.shared_data import shared_data

pytestmark = pytest.mark.e2e
LATE_S = 0.4
"""Either way: twice as long as from when a network is poor."""
PAUSED, LEAVES = "Paused: your network is too slow", "This picture of you leaves"


class Sender:
    """A page that sends pictures of its person, of whom the server keeps them."""

    def __init__(self, page: Page, kept: Kept) -> None:
        self.page, self.kept = page, kept
        self.words, self.note = page.locator("#live-look-words"), page.get_by_test_id("audio-only")

    def pictures_come(self) -> None:
        """They leave, and the server shows them."""
        expect(self.words).to_contain_text(LEAVES, timeout=2 * MINUTE)
        shown = len(self.kept.pictures)

        def came() -> bool:
            self.page.wait_for_timeout(200)
            return len(self.kept.pictures) >= shown + 5

        until(came, "pictures", 240.0)

    def nothing_leaves(self) -> bool:
        """For a second."""
        sent = self.page.evaluate(OUTGOING_VIDEO)
        self.page.wait_for_timeout(1000)
        return self.page.evaluate(OUTGOING_VIDEO) == sent

    def pictures_pause(self) -> None:
        """None leaves, but for what the browser had sent in vain; the switch is as it was, and
        motion goes on."""
        expect(self.words).to_contain_text(PAUSED, timeout=2 * MINUTE)
        expect(self.page.get_by_test_id("live-look-preview")).to_be_hidden()
        expect(self.page.get_by_test_id("live-look")).to_be_checked()
        until(self.nothing_leaves, "the end of what was on its way")
        shown, sent = len(self.kept.pictures), self.page.evaluate(OUTGOING_VIDEO)
        moved = len(self.page.evaluate("captured"))

        def moves() -> bool:
            self.page.wait_for_timeout(200)
            return len(self.page.evaluate("captured")) >= moved + 5

        until(moves, "motion")
        assert len(self.kept.pictures) == shown
        assert self.page.evaluate(OUTGOING_VIDEO) == sent


def test_live_look_is_the_first_to_give_way_and_comes_back_by_itself(tmp_path: Path):
    clip = shared_data("real-monocular/webcam_upperbody_woman_asl.mp4")
    camera = webcam(clip, tmp_path / "webcam.mjpeg")
    with (
        serving(tmp_path / "data", **networks()) as gateway,
        late_line(urlsplit(gateway.address).port or 0) as late,
        slow_line() as line,
        open_page(webcam=camera) as ada,
        beside(ada, viewport={"width": 480, "height": 400}) as bo,
    ):
        kept = Kept()
        gateway_of(gateway.app).views.driving_channels.make_look_sink = lambda *_: kept
        meeting = meeting_of(gateway)
        bo.add_init_script(HUM)
        come(bo, meeting, "Bo")
        bo.get_by_test_id("microphone").click()
        ada.add_init_script(PEERS)
        line.carry(ada)
        # a size that is asked for never gives way to sound
        enter(ada, meeting.replace(gateway.address, late.address).replace("&size=128", ""))
        ada.get_by_test_id("render-mode").select_option("server", force=True)
        sender = Sender(ada, kept)
        ada.get_by_test_id("live-look").click()
        sender.pictures_come()

        late.late_s = LATE_S
        sender.pictures_pause()
        pictures, heard = frames_shown(ada), ada.evaluate(AUDIO_BYTES)
        until(
            lambda: ada.wait_for_timeout(200) or frames_shown(ada) > pictures, "pictures of others"
        )
        assert ada.evaluate(AUDIO_BYTES) > heard, "all else stays"
        expect(sender.note).to_have_count(0)
        late.late_s = 0.0
        sender.pictures_come()

        line.bit_per_s = STARVED_BIT_PER_S
        expect(sender.note).to_have_count(1, timeout=2 * MINUTE)
        sender.pictures_pause()
        heard = ada.evaluate(AUDIO_BYTES)
        until(lambda: ada.wait_for_timeout(200) or ada.evaluate(AUDIO_BYTES) > heard, "a voice")
        line.bit_per_s = None
        expect(sender.note).to_have_count(0, timeout=2 * MINUTE)
        sender.pictures_come()
