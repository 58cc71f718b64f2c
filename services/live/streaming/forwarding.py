"""Encoded media from one connection to others, without decoding, encoding or mixing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from aiortc import MediaStreamTrack, RTCRtpReceiver
from av.packet import Packet

from services.live.aiortc_compat import RtpPacket, on_encoded_frame, on_rtp_packet
from services.live.streaming.voice_slots import is_voice

OPUS_RATE = 48_000
"""Hz: of RTP timestamps of Opus, whatever the voice was sampled with (RFC 7587, section 4.1)."""
VIDEO_RATE = 90_000
_OPUS_FRAME_SAMPLES = 960
"""20 ms, the usual length of an Opus packet."""
_QUEUE_LENGTH = 10
"""Packets that may wait to be sent, 200 ms of voice: older ones would be heard as lag."""
_HALF_RANGE = 1 << 31


@dataclass(frozen=True)
class OpusPacket:
    """20 ms of a voice, usually, as the speaker's device encoded it."""

    payload: bytes
    timestamp: int
    """RTP, 48 kHz, modulo 2^32."""
    voice: bool
    """Whether it is louder than a quiet room."""


@dataclass(frozen=True)
class EncodedPicture:
    """One encoded picture of a shared screen."""

    payload: bytes
    timestamp: int
    """90 kHz, from the first picture."""
    key: bool
    """Whether it is a key frame, which can be decoded without the pictures before it."""


class OpusPacketFilter:
    """Passes on the RTP packets of Opus that arrive in order; late and empty ones are dropped."""

    def __init__(self, callback: Callable[[OpusPacket], None]) -> None:
        self._callback = callback
        self._newest: dict[int, int] = {}
        """SSRC -> timestamp of the newest packet."""

    def receive(self, packet: RtpPacket) -> None:
        """Take a packet as it arrives."""
        newest = self._newest.get(packet.ssrc)
        if not packet.payload or (newest is not None and not _is_later(packet.timestamp, newest)):
            return
        self._newest[packet.ssrc] = packet.timestamp
        level = packet.extensions.audio_level
        voice = is_voice(level[1] if level else None, len(packet.payload))
        self._callback(OpusPacket(packet.payload, packet.timestamp, voice))


def on_opus_packet(receiver: RTCRtpReceiver, callback: Callable[[OpusPacket], None]) -> None:
    """Have `callback` called with each Opus packet as it arrives; late ones are dropped."""
    on_rtp_packet(receiver, OpusPacketFilter(callback).receive)


def on_vp8_picture(receiver: RTCRtpReceiver, callback: Callable[[EncodedPicture], None]) -> None:
    """Have `callback` called with each complete VP8 picture."""

    def receive(data: bytes, timestamp: int) -> None:
        if data:
            # RFC 6386, section 9.1: the lowest bit is 0 in key frames
            callback(EncodedPicture(data, timestamp, not data[0] & 1))

    on_encoded_frame(receiver, receive)


class _ForwardedTrack(MediaStreamTrack):
    """Packets out as they are put in; the oldest are dropped where they are not fetched."""

    def __init__(self) -> None:
        super().__init__()
        self._queue: asyncio.Queue[Packet] = asyncio.Queue(_QUEUE_LENGTH)

    async def recv(self) -> Packet:
        """The next packet, once there is one."""
        return await self._queue.get()

    def _put(self, payload: bytes, pts: int, rate: int) -> None:
        packet = Packet(payload)
        packet.pts, packet.time_base = pts, Fraction(1, rate)
        self._queue.put_nowait(packet)


class ForwardedVoice(_ForwardedTrack):
    """A slot as one listener hears it: the packets of its speakers, on one time line."""

    kind = "audio"

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._start_s = clock, clock()
        self._source: object = None
        self._first_timestamp = 0
        self._origin = self._last = -_OPUS_FRAME_SAMPLES

    def send(self, source: object, packet: OpusPacket) -> None:
        """Send a packet of `source`; after a change of source, time goes on by the clock."""
        if source is not self._source:
            elapsed = int((self._clock() - self._start_s) * OPUS_RATE)
            self._source, self._first_timestamp = source, packet.timestamp
            self._origin = max(self._last + _OPUS_FRAME_SAMPLES, elapsed)
        if self._queue.full():
            self._queue.get_nowait()
        self._last = self._origin + ((packet.timestamp - self._first_timestamp) & 0xFFFF_FFFF)
        self._put(packet.payload, self._last, OPUS_RATE)


class ForwardedScreen(_ForwardedTrack):
    """A shared screen as one viewer sees it; requests a key frame where a picture was lost."""

    kind = "video"

    def __init__(self, clock: Callable[[], float], on_key_frame_needed: Callable[[], None]) -> None:
        super().__init__()
        self._clock, self._start_s = clock, clock()
        self._on_key_frame_needed = on_key_frame_needed
        self._source: object = None
        self._origin = self._last = 0
        self._decodable = False
        """Whether the viewer has every picture since the last key frame."""

    def send(self, source: object, picture: EncodedPicture) -> None:
        """Send a picture of `source`, from its first key frame on."""
        if source is not self._source:
            elapsed = int((self._clock() - self._start_s) * VIDEO_RATE)
            self._source, self._decodable = source, False
            self._origin = max(self._last + 1, elapsed) - picture.timestamp
        if self._queue.full():  # the connection is too slow: go on from the next key frame
            self._decodable = False
        if not (self._decodable or picture.key):
            self._on_key_frame_needed()
            return
        while picture.key and not self._queue.empty():
            self._queue.get_nowait()
        self._decodable = True
        self._last = self._origin + picture.timestamp
        self._put(picture.payload, self._last, VIDEO_RATE)


def _is_later(timestamp: int, than: int) -> bool:
    return 0 < (timestamp - than) % (1 << 32) < _HALF_RANGE
