"""What the server relies on in aiortc is checked, kept in one module, and bypasses the decoder."""

from __future__ import annotations

import ast
import asyncio
import re
from pathlib import Path

import pytest
from aiortc import RTCConfiguration, RTCPeerConnection, RTCRtpReceiver, RTCRtpSender

from services.live.aiortc_compat import (
    KNOWN_VERSION,
    IncompatibleAiortc,
    on_rtp_packet,
    require_internals,
)
from tests.services.control.test_voices import Tone

SERVICES = Path(__file__).resolve().parents[3] / "services"


class OtherReceiver:
    """A receiver that takes other arguments and has no decoder queue."""

    def __init__(self) -> None:
        self.kind = "audio"

    async def _handle_rtp_packet(self, packet, arrival_time_ms):
        """As today."""

    async def _send_rtcp_pli(self, media_ssrc):
        """As today."""


class OtherSender(RTCRtpSender):
    """A sender whose handler takes something else."""

    async def _handle_rtcp_packet(self, packet, arrival_time_ms):  # type: ignore[override]
        """Other parameters."""


class NoReceiver:
    """Nothing of what is needed."""


@pytest.mark.parametrize(
    ("receiver", "sender", "words"),
    [
        (NoReceiver, RTCRtpSender, "RTCRtpReceiver._handle_rtp_packet"),
        (OtherReceiver, RTCRtpSender, "RTCRtpReceiver._RTCRtpReceiver__decoder_queue"),
        (RTCRtpReceiver, OtherSender, "RTCRtpSender._handle_rtcp_packet"),
    ],
)
def test_what_is_missing_is_named_with_both_versions(receiver, sender, words):
    with pytest.raises(IncompatibleAiortc, match=re.escape(words)) as caught:
        require_internals(receiver, sender, "9.9.1")
    assert f"as {KNOWN_VERSION} has" in str(caught.value)
    assert "in aiortc 9.9.1" in str(caught.value)


def test_no_other_module_reaches_into_aiortc():
    for path in SERVICES.rglob("*.py"):
        if path.name == "aiortc_compat.py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                assert not node.module.startswith(("aiortc.", "aioice")), (path, node.module)
            elif isinstance(node, ast.Import):
                assert not any(one.name.startswith(("aiortc.", "aioice")) for one in node.names)
            elif isinstance(node, ast.Attribute):
                # os._exit is documented
                own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls", "os")
                private = node.attr.startswith("_") and not node.attr.endswith("__")
                live = SERVICES / "live" in path.parents
                assert own or not (private and live), (path, node.attr)


async def test_packets_arrive_and_nothing_is_decoded():
    here, there = (RTCPeerConnection(RTCConfiguration(iceServers=[])) for _ in range(2))
    here.addTransceiver(Tone(), direction="sendonly")
    receiver = there.addTransceiver("audio", direction="recvonly").receiver
    arrived = asyncio.Event()
    on_rtp_packet(receiver, lambda packet: arrived.set())
    await here.setLocalDescription(await here.createOffer())
    await there.setRemoteDescription(here.localDescription)
    await there.setLocalDescription(await there.createAnswer())
    await here.setRemoteDescription(there.localDescription)
    async with asyncio.timeout(20):
        await arrived.wait()
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(receiver.track.recv(), 0.5)
    await here.close()
    await there.close()
