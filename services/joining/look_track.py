"""The pictures that somebody sends of themselves, as a track of encoded video."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from aiortc import MediaStreamTrack
from av import Packet, VideoFrame

from scene.arrays import Array, UInt8
from services.live.streaming.encoding import FRAMES_PER_SECOND, Codec, PictureEncoder

BITRATE, SPEED = 225_000, 6
"""bit/s, as pages send at most, and how fast VP8 is coded, as browsers do."""


class LookTrack(MediaStreamTrack):
    """Sends the newest picture, once; on one event loop."""

    kind = "video"

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._encoder = clock, PictureEncoder(Codec.VP8, SPEED)
        self._start_s, self._tick = clock(), 0
        self._newest: UInt8[Array, "528 384 3"] | None = None
        self._came, self._key_frame_requested = asyncio.Event(), True

    def show(self, picture: UInt8[Array, "528 384 3"]) -> None:
        """Send `picture` (sRGB) next; one that still waits is dropped."""
        self._newest = picture
        self._came.set()

    def request_key_frame(self) -> None:
        """Have the next picture need none before it."""
        self._key_frame_requested = True

    async def recv(self) -> Packet:
        """The next picture's frame of VP8."""
        while True:
            await self._came.wait()
            self._came.clear()
            assert self._newest is not None
            frame = VideoFrame.from_ndarray(self._newest, format="rgb24")
            now = round(FRAMES_PER_SECOND * (self._clock() - self._start_s))
            self._tick = max(now, self._tick + 1)
            key, self._key_frame_requested = self._key_frame_requested, False
            yuv = frame.reformat(format="yuv420p")
            packet = self._encoder.encode(yuv, self._tick, BITRATE, key=key)
            if packet.size:  # the coder leaves one out now and then, to keep to its bitrate
                return packet
            self._key_frame_requested |= key
