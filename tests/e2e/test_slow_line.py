"""A page whose line is starved: pictures go, sound stays, and pictures return once it is good."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from benchmarks.browser import open_page, running_demo
from tests.e2e.slow_line import SlowLine, slow_line
from tests.e2e.test_control import HUM, beside, come, serious_faults
from tests.e2e.test_meeting import watch
from tests.e2e.viewport import frames_shown

pytestmark = pytest.mark.e2e
MINUTE = 60_000
STARVED_BIT_PER_S = 100_000.0
"""Enough for voices; the smallest picture takes some 500 kbit/s."""
WORDS = "Your connection is too slow for video. You can still hear everybody."
_VOICE_BYTES = 16_000
"""Several seconds of a voice."""
_PATIENCE_S = 20.0

PEERS = """
window.peers = [];
const Peer = RTCPeerConnection;
RTCPeerConnection = class extends Peer { constructor(...all) { super(...all); peers.push(this); } };
"""
AUDIO_BYTES = """async () => {
  let bytes = 0;
  for (const peer of peers) {
    (await peer.getStats()).forEach(entry => {
      if (entry.type === "inbound-rtp" && entry.kind === "audio") bytes += entry.bytesReceived;
    });
  }
  return bytes;
}"""


def talks(page: Page, address: str) -> None:
    """Bo, at small pictures, hums into the microphone."""
    page.add_init_script(HUM)
    come(page, f"{address}?size=128", "Bo")
    page.get_by_test_id("microphone").click()
    expect(page.get_by_test_id("microphone")).to_have_attribute(
        "aria-pressed", "true", timeout=MINUTE
    )


def sound_flows_alone(page: Page, line: SlowLine) -> None:
    """Bytes of voices come, and the service sends little else."""
    heard, offered, began_s = page.evaluate(AUDIO_BYTES), line.offered_bits, time.monotonic()
    while page.evaluate(AUDIO_BYTES) - heard < _VOICE_BYTES:
        assert time.monotonic() - began_s < _PATIENCE_S, "no voice came"
        page.wait_for_timeout(100)
    assert line.offered_bits - offered < STARVED_BIT_PER_S * (time.monotonic() - began_s)


def test_on_a_starved_line_pictures_go_sound_stays_and_pictures_return(tmp_path: Path):
    with (
        running_demo(tmp_path / "data") as address,
        slow_line() as line,
        open_page() as ada,
        beside(ada, viewport={"width": 480, "height": 400}) as bo,
    ):
        talks(bo, address)
        ada.add_init_script(PEERS)
        line.carry(ada)
        come(ada, address, "Ada")
        watch(ada, 20)
        ada.wait_for_function(f"async () => await ({AUDIO_BYTES})() > 5000", timeout=MINUTE)
        assert line.offered_bits > 0  # this way, and no other

        before = frames_shown(bo)
        line.bit_per_s = STARVED_BIT_PER_S
        note = ada.get_by_test_id("audio-only")
        expect(note).to_contain_text(WORDS, timeout=MINUTE)
        expect(ada.locator("#announcer")).to_contain_text(WORDS)
        sound_flows_alone(ada, line)
        assert serious_faults(ada) == []
        assert frames_shown(bo) > before + 20  # nobody else is slowed down
        expect(bo.get_by_test_id("audio-only")).to_have_count(0)

        line.bit_per_s = None
        expect(note).to_have_count(0, timeout=2 * MINUTE)
        expect(ada.locator("#announcer")).to_contain_text("Video is back")
        watch(ada, 20)
