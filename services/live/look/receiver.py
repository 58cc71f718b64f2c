"""The pictures of themselves that somebody sends over their WHEP connection.

A frame is 384 x 528 px: the person on black, 384 x 384 (`services.live.look.keying`), and below
them the code of `services.live.look.picture_code`. Frames are decoded only while they are of
somebody whom this connection drives by keypoints, and only while the newest keypoints say that live
look is on: nobody's pictures are looked at against their will. Encoded frames go on to pages that
draw by themselves; they wait on the event loop and are decoded by a process
(`services.live.look.decoder`), all of them, since each builds on the last, and only the newest
becomes a picture.
"""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor

from prometheus_client import Counter

from scene.arrays import Array, UInt8
from services.live.look import picture_code
from services.live.look.decoder import DecodingFailed, LookDecoder
from services.live.look.keeping import Keeping
from services.live.look.keying import lowered
from services.live.look.picture import AlignedPose, LookPicture, LookSink, PoseRequest
from services.live.look.relay import LookRelay, NoRelay

log = logging.getLogger(__name__)

PICTURES = Counter(
    "metanerf_look_pictures_total", "Pictures for live look, by what became of them.", ["outcome"]
)
"""shown; refused (of nobody who may be shown, or not announced); replaced (by a newer one, while it
waited); unreadable (of another size, damaged, or without a code)."""
PICTURE_PX = 384
FRAME_SIZE = (PICTURE_PX, PICTURE_PX + picture_code.SIDE_PX)
"""Width and height, px."""
SILENCE_S = 1.0
"""After the last picture it is no longer how they look now."""
_MOST_WAITING = 15
"""Frames, a second's: a decoder that is so far behind starts anew from a key frame."""
_LARGEST_FRAME_BYTES = 128 << 10
"""More than a page's pictures of six seconds."""
_KEY_FRAME_INTERVAL_S = 0.5
_VP8_START_CODE = b"\x9d\x01\x2a"
_SIZE_BITS = 0x3FFF
"""The two above tell how to scale."""


class LookReceiver:
    """The pictures that come over one connection. Every method runs on its event loop."""

    def __init__(
        self, executor: Executor, request_key_frame: Callable[[], Awaitable[None]]
    ) -> None:
        """A thread of `executor` waits for what is decoded; `request_key_frame` asks for a frame
        that needs none before it."""
        self._executor, self._request_key_frame = executor, request_key_frame
        self._decoder = LookDecoder(FRAME_SIZE)
        self._sink: LookSink | None = None
        self._relay: LookRelay = NoRelay()
        self._frames = 0
        """Passed on so far."""
        self._announced = False
        self._continuous = False
        """Whether the decoder has had every frame since a key frame of the right size."""
        self._waiting: list[tuple[int, bytes]] = []
        """Frames and their numbers."""
        self._decoding: asyncio.Task[None] | None = None
        self._asking: asyncio.Future[None] | None = None
        self._asked_s = -_KEY_FRAME_INTERVAL_S
        self._silence: asyncio.TimerHandle | None = None

    @property
    def keeping(self) -> Keeping | None:
        """What is kept of the pictures; None where they are nobody's, or cannot be kept."""
        return None if self._sink is None else self._sink.keeping

    def attach(self, sink: LookSink, relay: LookRelay | None = None) -> None:
        """Pictures are of whom `sink` shows, once they are announced, and of nobody else; frames go
        on to `relay`."""
        self.announce(False)
        self._sink, self._relay = sink, relay or NoRelay()

    def detach(self, sink: LookSink) -> None:
        """They no longer are; `sink` is stopped."""
        if self._sink is sink:
            self.announce(False)
            self._sink, self._relay = None, NoRelay()
        sink.stop()
        if sink.keeping is not None:
            sink.keeping.drop()

    def close(self) -> None:
        """Take no more frames; what decoded them ends soon."""
        self.announce(False)
        self._sink = None
        self._executor.submit(self._decoder.close)

    def announce(self, on: bool) -> None:
        """Say whether the newest keypoints come with live look on; without it pictures end."""
        if on == self._announced:
            return
        self._announced = on
        if not on:
            self._stop()

    def on_frame(self, data: bytes) -> None:
        """Take an encoded frame (VP8) of the connection; returns at once."""
        if self._sink is None or not self._announced:
            self._continuous = False
            PICTURES.labels("refused").inc()
            return
        if len(self._waiting) >= _MOST_WAITING:
            self._drop_waiting()
        size = key_frame_size(data)
        if size is not None:
            self._continuous = size == FRAME_SIZE
        if len(data) > _LARGEST_FRAME_BYTES:
            self._continuous = False
        if not self._continuous:
            PICTURES.labels("unreadable").inc()
            self._ask_for_key_frame()
            return
        self._frames += 1
        if self._relay.pass_frame(self._frames, data):
            self._ask_for_key_frame()
        self._waiting.append((self._frames, data))
        if self._decoding is None:
            self._decoding = asyncio.create_task(self._decode())

    async def _decode(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            while self._waiting:
                frames, self._waiting = self._waiting, []
                picture = await loop.run_in_executor(self._executor, self._newest, frames)
                PICTURES.labels("replaced").inc(len(frames) - 1)
                if picture is None:
                    PICTURES.labels("unreadable").inc()
                elif self._sink is not None and self._announced:
                    self._show(self._sink, picture, frames[-1][0])
                else:  # switched off meanwhile
                    PICTURES.labels("refused").inc()
        except DecodingFailed as error:
            PICTURES.labels("unreadable").inc()
            log.debug("a picture could not be decoded: %s", error)
            self._drop_waiting()
        except Exception:
            # an error in a sink must not end the pictures
            log.exception("a picture could not be shown")
        finally:
            self._decoding = None

    def _newest(self, frames: list[tuple[int, bytes]]) -> LookPicture | None:
        """On a thread: the last frame's picture. Raises DecodingFailed."""
        shown = self._decoder.newest([data for _, data in frames])
        return None if shown is None else picture_of(shown)

    def _show(self, sink: LookSink, picture: LookPicture, number: int) -> None:
        PICTURES.labels("shown").inc()
        self._forget_silence()
        self._silence = asyncio.get_running_loop().call_later(SILENCE_S, self._stop)
        sink.receive(picture, self._pose_request(number))

    def _pose_request(self, number: int) -> PoseRequest | None:
        """For the pose of the frame of this number, where pages draw whom it shows."""
        loop, relay, model = asyncio.get_running_loop(), self._relay, self._relay.drawn_model()

        def pass_on(aligned: AlignedPose) -> None:
            if self._relay is relay and self._announced:
                relay.pass_pose(number, aligned)

        def deliver(aligned: AlignedPose) -> None:
            loop.call_soon_threadsafe(pass_on, aligned)

        return None if model is None else PoseRequest(model, deliver)

    def _stop(self) -> None:
        self._drop_waiting()
        self._forget_silence()
        self._relay.end()
        if self._sink is not None:
            self._sink.stop()

    def _forget_silence(self) -> None:
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None

    def _drop_waiting(self) -> None:
        PICTURES.labels("replaced").inc(len(self._waiting))
        self._waiting = []
        self._continuous = False

    def _ask_for_key_frame(self) -> None:
        now_s = asyncio.get_running_loop().time()
        if now_s - self._asked_s < _KEY_FRAME_INTERVAL_S:
            return
        self._asked_s = now_s
        self._asking = asyncio.ensure_future(self._request_key_frame())


def key_frame_size(data: bytes) -> tuple[int, int] | None:
    """Width and height (px) that a VP8 key frame tells (RFC 6386, section 9.1); None of others."""
    if len(data) < 10 or data[0] & 1 or data[3:6] != _VP8_START_CODE:
        return None
    width, height = int.from_bytes(data[6:8], "little"), int.from_bytes(data[8:10], "little")
    return width & _SIZE_BITS, height & _SIZE_BITS


def offers_pictures(sdp_offer: str) -> bool:
    """Whether the second video section of a viewer's offer sends."""
    sections = [one for one in re.split(r"(?m)^m=", sdp_offer) if one.startswith("video")]
    return len(sections) > 1 and "a=sendonly" in sections[1].splitlines()


def picture_of(rgb: UInt8[Array, "528 384 3"]) -> LookPicture | None:
    """What a decoded frame shows; None where there is no code in it."""
    code = picture_code.read(rgb[PICTURE_PX:, : picture_code.SIDE_PX, 1])
    if code is None:
        return None
    window = code.x, code.y, code.side
    return LookPicture(code.captured_ms, window, *lowered(rgb[:PICTURE_PX]))
