"""What plays the part of a webcam for whoever joins from the command line, and a clip as one."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from capture.sources.video import FilmedFrame, played_frames


@dataclass(frozen=True, eq=False)
class WebcamFrame:
    """One frame, as it comes."""

    captured_ms: float
    """Since 1970; each is later than the one before."""
    frame: FilmedFrame


class Webcam(Protocol):
    """Gives one frame after another."""

    @property
    def name(self) -> str:
        """As people are told of it."""
        ...

    def frames(
        self, executor: Executor, should_stop: Callable[[], bool]
    ) -> AsyncGenerator[WebcamFrame]:
        """Each time it is asked, the newest frame, once it is there; what came meanwhile is left
        out. Decoding may be done on `executor`."""
        ...


class ClipWebcam(Webcam):
    """Plays a clip as fast as it was filmed, once or in a loop."""

    def __init__(self, clip: Path, *, loop: bool) -> None:
        self._clip, self._loop = clip, loop

    @property
    def name(self) -> str:
        """The file's."""
        return self._clip.name

    async def frames(
        self, executor: Executor, should_stop: Callable[[], bool]
    ) -> AsyncGenerator[WebcamFrame]:
        """To the clip's end, or in a loop until `should_stop`. Raises UnreadableClip."""
        running, again = asyncio.get_running_loop(), True
        while again and not should_stop():
            played, begun_s = played_frames(self._clip), time.time()
            while not should_stop():
                now_s = time.time() - begun_s
                frame = await running.run_in_executor(executor, _newest, played, now_s)
                if frame is None:
                    break
                await asyncio.sleep(max(0.0, begun_s + frame.time_s - time.time()))
                yield WebcamFrame(1e3 * (begun_s + frame.time_s), frame)
            again = self._loop


def _newest(frames: Iterator[FilmedFrame], now_s: float) -> FilmedFrame | None:
    """On the executor: the first frame from `now_s` on; None at the clip's end."""
    return next((frame for frame in frames if frame.time_s >= now_s), None)
