"""Plays a clip, or a video that comes by WHIP, into a meeting in the place of a webcam."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing
from dataclasses import dataclass
from typing import NamedTuple

from scene.arrays import Array, UInt8
from services.joining.cut_out import CutOut
from services.joining.finder import PersonFinder
from services.joining.presence import Presence, present
from services.joining.seat import Seat
from services.joining.webcams import Webcam, WebcamFrame
from services.live.keypoints_packet import KeypointsPacket

WEBCAM_PX = 640
"""A page asks its camera for no more; landmarks need no more."""


@dataclass
class Played:
    """What became of a webcam's frames so far."""

    frames: int = 0
    """Looked at. What comes while one is looked at is left out, as on a page."""
    sent: int = 0
    """Landmarks that went out."""
    pictures: int = 0
    """Pictures that went out with them."""


class _Looked(NamedTuple):
    """What a frame shows, as it is sent."""

    packet: KeypointsPacket | None
    picture: UInt8[Array, "528 384 3"] | None


class WebcamPlayer:
    """Plays one webcam."""

    def __init__(self, webcam: Webcam, finder: PersonFinder, *, live_look: bool) -> None:
        self.played = Played()
        self._webcam, self._finder = webcam, finder
        self._cut_out = CutOut() if live_look else None

    async def play(self, seat: Seat, *, should_stop: Callable[[], bool] = lambda: False) -> Played:
        """Join, play to the webcam's end or until `should_stop`, and leave.

        Raises UnreadableClip, and NotJoined where the meeting can't be joined or had to be left.
        """
        # networks and decoder work on a thread, so that the connection is kept up meanwhile
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="find") as executor:
            async with present(seat, live_look=self._cut_out is not None) as visit:
                running = asyncio.get_running_loop()
                async with aclosing(self._webcam.frames(executor, should_stop)) as frames:
                    async for frame in frames:
                        looked = await running.run_in_executor(executor, self._look, frame)
                        self._send(visit, looked)
        return self.played

    def _send(self, visit: Presence, looked: _Looked) -> None:
        self.played.frames += 1
        if looked.packet is None or not visit.send(looked.packet):
            return
        self.played.sent += 1
        if looked.picture is not None:
            visit.show(looked.picture)
            self.played.pictures += 1

    def _look(self, frame: WebcamFrame) -> _Looked:
        """On the thread."""
        image, captured_ms = frame.frame.image(WEBCAM_PX), frame.captured_ms
        found = self._finder.find(image)
        if found is None:
            return _Looked(None, None)
        size = (image.shape[1], image.shape[0])
        packet = KeypointsPacket(
            0,
            captured_ms,
            *size,
            found.body.pixels / size,
            found.body.world,
            found.body.visibility,
            found.expression if found.expression.known else None,
            round(1e3 * time.time() - captured_ms),
            head=found.head,
        )
        cut_out = self._cut_out
        picture = None if cut_out is None else cut_out.draw(image, found.body, captured_ms)
        return _Looked(packet, picture)
