"""Plays a clip into a meeting in the place of a webcam, as fast as it was filmed."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from capture.sources.video import FilmedFrame, played_frames
from scene.arrays import Array, UInt8
from services.joining.cut_out import CutOut
from services.joining.finder import PersonFinder
from services.joining.presence import Presence, present
from services.joining.seat import Seat
from services.live.keypoints_packet import KeypointsPacket

WEBCAM_PX = 640
"""A page asks its camera for no more; landmarks need no more."""


@dataclass
class Played:
    """What became of a clip's frames so far."""

    frames: int = 0
    """Looked at. What comes while one is looked at is left out, as a webcam's is."""
    sent: int = 0
    """Landmarks that went out."""
    pictures: int = 0
    """Pictures that went out with them."""


class _Looked(NamedTuple):
    """What a frame shows, as it is sent."""

    packet: KeypointsPacket | None
    picture: UInt8[Array, "432 288 3"] | None


class ClipPlayer:
    """Plays one clip."""

    def __init__(self, clip: Path, finder: PersonFinder, *, live_look: bool) -> None:
        self.played = Played()
        self._clip, self._finder = clip, finder
        self._cut_out = CutOut() if live_look else None

    async def play(
        self,
        seat: Seat,
        *,
        loop: bool = False,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> Played:
        """Join, play the clip once, or in a `loop` until `should_stop`, and leave.

        Raises UnreadableClip, and NotJoined where the meeting can't be joined or had to be left.
        """
        # networks and decoder work on a thread, so that the connection is kept up meanwhile
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="find") as executor:
            async with present(seat, live_look=self._cut_out is not None) as visit:
                again = True
                while again and not should_stop():
                    await self._play_once(visit, executor, should_stop)
                    again = loop
        return self.played

    async def _play_once(
        self,
        visit: Presence,
        executor: ThreadPoolExecutor,
        should_stop: Callable[[], bool],
    ) -> None:
        running, frames = asyncio.get_running_loop(), played_frames(self._clip)
        begun_s = time.time()
        while not should_stop():
            now_s = time.time() - begun_s
            frame = await running.run_in_executor(executor, _newest, frames, now_s)
            if frame is None:
                return
            await asyncio.sleep(max(0.0, begun_s + frame.time_s - time.time()))
            captured_ms = 1e3 * (begun_s + frame.time_s)
            looked = await running.run_in_executor(executor, self._look, frame, captured_ms)
            self.played.frames += 1
            if looked.packet is None or not visit.send(looked.packet):
                continue
            self.played.sent += 1
            if looked.picture is not None:
                visit.show(looked.picture)
                self.played.pictures += 1

    def _look(self, frame: FilmedFrame, captured_ms: float) -> _Looked:
        """On the thread."""
        image = frame.image(WEBCAM_PX)
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
        )
        cut_out = self._cut_out
        picture = None if cut_out is None else cut_out.draw(image, found.body, captured_ms)
        return _Looked(packet, picture)


def _newest(frames: Iterator[FilmedFrame], now_s: float) -> FilmedFrame | None:
    """On the thread: the first frame from `now_s` on; None at the clip's end."""
    return next((frame for frame in frames if frame.time_s >= now_s), None)
