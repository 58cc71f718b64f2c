"""Encoded media from one connection to others: no decoder, no encoder, no mixer in between.

aiortc sends `av.Packet`s as they are, but decodes whatever comes in and has no public way to the
packets themselves. `tap_opus` and `tap_video` step in between its receiver and its decoder; they
touch two private names of aiortc 1.16, which is pinned, and a test fails where they are gone.
"""

from __future__ import annotations

import asyncio
import queue
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from aiortc import MediaStreamTrack, RTCRtpReceiver
from aiortc.rtp import RtpPacket
from av.packet import Packet

from services.live.streaming.voice_slots import is_voice

OPUS_RATE = 48_000
"""Hz: of RTP timestamps of Opus, whatever the voice was sampled with (RFC 7587, section 4.1)."""
VIDEO_RATE = 90_000
_OPUS_STEP = 960
"""20 ms, the usual length of an Opus packet."""
_MOST_WAITING = 10
"""Packets that may wait to be sent, 200 ms of voice: older ones would be heard as lag."""
_HALF = 1 << 31
_DECODER_QUEUE = "_RTCRtpReceiver__decoder_queue"


@dataclass(frozen=True)
class OpusPacket:
    """20 ms of somebody's voice, usually, as they encoded it."""

    payload: bytes
    timestamp: int
    """RTP, 48 kHz, modulo 2^32."""
    voice: bool
    """Whether it is louder than a quiet room."""


@dataclass(frozen=True)
class VideoFrame:
    """One encoded picture."""

    payload: bytes
    timestamp: int
    """90 kHz, from the first picture."""
    key: bool
    """Whether it can be decoded without the ones before."""


class _Undecoded(queue.Queue[Any]):
    """Where aiortc puts frames to be decoded: hands them on, and leaves the decoder idle."""

    def __init__(self, take: Callable[[Any], None]) -> None:
        super().__init__()
        self._take = take

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        if item is None:  # ends the decoder's thread
            super().put(None)
        else:
            self._take(item[1])


def tap_opus(receiver: RTCRtpReceiver, take: Callable[[OpusPacket], None]) -> None:
    """Have `take` called with each packet as it comes; late ones are left out."""
    handle = receiver._handle_rtp_packet
    newest: dict[int, int] = {}

    async def tapped(packet: RtpPacket, arrival_time_ms: int) -> None:
        # aiortc goes on to count packets for its reports
        await handle(packet, arrival_time_ms)
        before = newest.get(packet.ssrc)
        if not packet.payload or (before is not None and not _later(packet.timestamp, before)):
            return
        newest[packet.ssrc] = packet.timestamp
        level = packet.extensions.audio_level
        voice = is_voice(level[1] if level else None, len(packet.payload))
        take(OpusPacket(packet.payload, packet.timestamp, voice))

    setattr(receiver, _DECODER_QUEUE, _Undecoded(lambda frame: None))
    receiver._handle_rtp_packet = tapped  # type: ignore[method-assign]


def tap_video(receiver: RTCRtpReceiver, take: Callable[[VideoFrame], None]) -> None:
    """Have `take` called with each whole VP8 picture."""

    def taken(frame: Any) -> None:
        if frame.data:
            # RFC 6386, section 9.1: the lowest bit says that it needs those before
            take(VideoFrame(frame.data, frame.timestamp, not frame.data[0] & 1))

    setattr(receiver, _DECODER_QUEUE, _Undecoded(taken))


async def ask_for_key_frame(receiver: RTCRtpReceiver) -> None:
    """Have the sender send a picture that can be decoded by itself (RFC 4585, PLI)."""
    for source in receiver.getSynchronizationSources():
        await receiver._send_rtcp_pli(source.source)


class _Forwarded(MediaStreamTrack):
    """Packets out as they are put in; the oldest are dropped where they are not fetched."""

    def __init__(self) -> None:
        super().__init__()
        self._waiting: asyncio.Queue[Packet] = asyncio.Queue(_MOST_WAITING)

    async def recv(self) -> Packet:
        """The next packet, once there is one."""
        return await self._waiting.get()

    def _put(self, payload: bytes, pts: int, rate: int) -> None:
        packet = Packet(payload)
        packet.pts, packet.time_base = pts, Fraction(1, rate)
        self._waiting.put_nowait(packet)


class ForwardedVoice(_Forwarded):
    """A slot as one listener hears it: the packets of whoever holds it, on one time line."""

    kind = "audio"

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._start_s = clock, clock()
        self._source: object = None
        self._first = 0
        self._origin = self._last = -_OPUS_STEP

    def offer(self, source: object, packet: OpusPacket) -> None:
        """Send a packet of `source`; where another spoke before, time goes on by the clock."""
        if source is not self._source:
            elapsed = int((self._clock() - self._start_s) * OPUS_RATE)
            self._source, self._first = source, packet.timestamp
            self._origin = max(self._last + _OPUS_STEP, elapsed)
        if self._waiting.full():
            self._waiting.get_nowait()
        self._last = self._origin + ((packet.timestamp - self._first) & 0xFFFF_FFFF)
        self._put(packet.payload, self._last, OPUS_RATE)


class ForwardedVideo(_Forwarded):
    """A shared screen as one viewer sees it; asks for a whole picture where one was lost."""

    kind = "video"

    def __init__(self, clock: Callable[[], float], ask_for_key: Callable[[], None]) -> None:
        super().__init__()
        self._clock, self._start_s = clock, clock()
        self._ask_for_key = ask_for_key
        self._source: object = None
        self._origin = self._last = 0
        self._whole = False

    def offer(self, source: object, frame: VideoFrame) -> None:
        """Send a picture of `source`, from its first whole one on."""
        if source is not self._source:
            elapsed = int((self._clock() - self._start_s) * VIDEO_RATE)
            self._source, self._whole = source, False
            self._origin = max(self._last + 1, elapsed) - frame.timestamp
        if self._waiting.full():  # the viewer's line is clogged: go on from the next whole picture
            self._whole = False
        if not (self._whole or frame.key):
            self._ask_for_key()
            return
        while frame.key and not self._waiting.empty():
            self._waiting.get_nowait()
        self._whole = True
        self._last = self._origin + frame.timestamp
        self._put(frame.payload, self._last, VIDEO_RATE)


def _later(timestamp: int, than: int) -> bool:
    return 0 < (timestamp - than) % (1 << 32) < _HALF
