"""The only module that goes beyond what aiortc documents.

aiortc sends encoded packets (`av.Packet`) as they are, but it decodes everything that it receives,
handles all RTCP feedback itself, and has no public way to either. The functions below reach both
through private attributes of `RTCRtpReceiver` and `RTCRtpSender`. pyproject.toml pins aiortc;
importing this module fails where one of these attributes is gone.
"""

from __future__ import annotations

import inspect
import queue
from collections.abc import Callable
from types import FunctionType
from typing import Any

import aiortc
from aiortc import RTCRtpReceiver, RTCRtpSender
from aiortc.mediastreams import MediaStreamError
from aiortc.rtp import (
    RTCP_PSFB_APP,
    RTCP_PSFB_FIR,
    RTCP_PSFB_PLI,
    AnyRtcpPacket,
    RtcpPsfbPacket,
    RtcpRrPacket,
    RtcpRtpfbPacket,
    RtpPacket,
    unpack_remb_fci,
)
from aiortc.sdp import MediaDescription, SessionDescription, candidate_from_sdp

__all__ = [
    "KNOWN_VERSION",
    "RTCP_PSFB_APP",
    "RTCP_PSFB_FIR",
    "RTCP_PSFB_PLI",
    "AnyRtcpPacket",
    "IncompatibleAiortc",
    "MediaDescription",
    "MediaStreamError",
    "RtcpPsfbPacket",
    "RtcpRrPacket",
    "RtcpRtpfbPacket",
    "RtpPacket",
    "SessionDescription",
    "candidate_from_sdp",
    "on_encoded_frame",
    "on_key_frame_request",
    "on_rtcp_packet",
    "on_rtp_packet",
    "request_key_frame",
    "require_internals",
    "unpack_remb_fci",
]

KNOWN_VERSION = "1.16"
"""The aiortc release whose private attributes are used here."""
_METHODS = {
    "RTCRtpReceiver": {
        "_handle_rtp_packet": ("self", "packet", "arrival_time_ms"),
        "_send_rtcp_pli": ("self", "media_ssrc"),
    },
    "RTCRtpSender": {
        "_handle_rtcp_packet": ("self", "packet"),
        "_send_keyframe": ("self",),
    },
}
"""By class: private methods, with the parameters that they must have."""
_DECODER_QUEUE = "_RTCRtpReceiver__decoder_queue"
_INSTANCE_ATTRIBUTES = {"RTCRtpReceiver": (_DECODER_QUEUE,), "RTCRtpSender": ("_ssrc",)}
"""By class: private attributes that `__init__` must set."""


class IncompatibleAiortc(ImportError):
    """The installed aiortc lacks a private attribute that this server needs."""


def require_internals(receiver: type, sender: type, version: str) -> None:
    """Check the private attributes of aiortc's receiver and sender classes.

    Raises IncompatibleAiortc, which names the first that is missing or has other parameters.
    """
    for name, cls in (("RTCRtpReceiver", receiver), ("RTCRtpSender", sender)):
        for method, parameters in _METHODS[name].items():
            found = getattr(cls, method, None)
            if found is None:
                raise _incompatible(f"{name}.{method}", "no such method", version)
            if (actual := tuple(inspect.signature(found).parameters)) != parameters:
                raise _incompatible(f"{name}.{method}{parameters}", f"parameters {actual}", version)
        for attribute in _INSTANCE_ATTRIBUTES[name]:
            initialise = cls.__init__
            names = initialise.__code__.co_names if isinstance(initialise, FunctionType) else ()
            if attribute not in names:
                raise _incompatible(f"{name}.{attribute}", "no such attribute", version)


def _incompatible(wanted: str, got: str, version: str) -> IncompatibleAiortc:
    return IncompatibleAiortc(
        f"aiortc must have {wanted}, as {KNOWN_VERSION} has; got {got} in aiortc {version}; "
        f"install aiortc {KNOWN_VERSION}, or adapt services/live/aiortc_compat.py"
    )


require_internals(RTCRtpReceiver, RTCRtpSender, aiortc.__version__)


class _BypassedDecoder(queue.Queue[Any]):
    """Replaces the decoder's input queue: frames go to a callback, and the decoder stays idle."""

    def __init__(self, callback: Callable[[Any], None]) -> None:
        super().__init__()
        self._callback = callback

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        if item is None:  # tells the decoder's thread to end
            super().put(None)
        else:
            _codec, frame = item
            self._callback(frame)


def on_rtp_packet(receiver: RTCRtpReceiver, callback: Callable[[RtpPacket], None]) -> None:
    """Have `callback` called with each RTP packet as it arrives, and nothing decoded.

    aiortc still counts the packets for its receiver reports. To be called before the remote
    description is set.
    """
    handle = receiver._handle_rtp_packet

    async def handle_and_call(packet: RtpPacket, arrival_time_ms: int) -> None:
        await handle(packet, arrival_time_ms)
        callback(packet)

    setattr(receiver, _DECODER_QUEUE, _BypassedDecoder(lambda _frame: None))
    receiver._handle_rtp_packet = handle_and_call  # type: ignore[method-assign]


def on_encoded_frame(receiver: RTCRtpReceiver, callback: Callable[[bytes, int], None]) -> None:
    """Have `callback` called with each complete encoded frame, and nothing decoded.

    It is given the frame's bytes and its RTP timestamp, counted from that of the first frame. To be
    called before the remote description is set.
    """
    setattr(
        receiver,
        _DECODER_QUEUE,
        _BypassedDecoder(lambda frame: callback(frame.data, frame.timestamp)),
    )


async def request_key_frame(receiver: RTCRtpReceiver) -> None:
    """Ask the remote sender for a key frame (Picture Loss Indication, RFC 4585, section 6.3.1)."""
    for source in receiver.getSynchronizationSources():
        await receiver._send_rtcp_pli(source.source)


def on_rtcp_packet(sender: RTCRtpSender, callback: Callable[[AnyRtcpPacket, int], None]) -> None:
    """Have `callback` called with each RTCP packet for `sender`, and the stream's SSRC.

    It is called before aiortc acts on the packet, so that it may change it.
    """
    handle = sender._handle_rtcp_packet

    async def call_and_handle(packet: AnyRtcpPacket) -> None:
        callback(packet, sender._ssrc)
        await handle(packet)

    sender._handle_rtcp_packet = call_and_handle  # type: ignore[method-assign]


def on_key_frame_request(sender: RTCRtpSender, callback: Callable[[], None]) -> None:
    """Have `callback` called when the remote side requests a key frame.

    aiortc would ask its own encoder, which is not used where packets are sent as they are.
    """
    sender._send_keyframe = callback  # type: ignore[method-assign]
