"""Decodes one sender's frames in a process of their own, which may crash without harm (`confined`).

A decoder is C code, and a frame is whatever its sender likes: one that takes the process over
reaches neither the gateway's memory nor anybody else's pictures.
"""

from __future__ import annotations

import fcntl
import logging
import math
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
from prometheus_client import Counter

from scene.arrays import Array, UInt8
from services.confinement import ConfinedProcess
from services.live.look.confined import DAMAGED, HEAD, PICTURE

log = logging.getLogger(__name__)

LOST = Counter(
    "metanerf_look_decoders_lost_total",
    "Processes that decoded somebody's pictures and crashed, or did not answer.",
)
START_S = 20.0
"""Of a machine that does much else, until the first answer."""
ANSWER_S = 3.0
_END_S = 0.5
_PIPE_BYTES = 1 << 19
"""A whole answer: the usual 64 KiB have each side wait for the other six times."""
RESTART_S = 5.0
"""Between two starts: frames that crash every process must not take all the time."""


class DecodingFailed(Exception):
    """Frames could not be decoded: a key frame is needed."""


class LookDecoder:
    """Decodes VP8; the process starts with the first frame, and anew where it ended."""

    def __init__(self, size: tuple[int, int], clock: Callable[[], float] = time.monotonic) -> None:
        """`size`: width and height of frames, px; others show nothing."""
        self._width, self._height = size
        self._clock, self._guard = clock, threading.Lock()
        self._process: ConfinedProcess | None = None
        self._answered = self._closed = False
        self._started_s = -math.inf

    def newest(self, frames: Sequence[bytes]) -> UInt8[Array, "H W 3"] | None:
        """The picture of the last of `frames` that shows one (sRGB); None where none does.

        Blocks; on one thread at a time. Raises DecodingFailed where a frame is damaged or the
        process has ended.
        """
        with self._guard:
            process = self._started()
            try:
                return self._decoded(process, frames)
            except OSError as error:  # it has ended, or takes too long
                how = self._end(process)
                if not self._closed:
                    LOST.inc()
                    log.warning("what decodes somebody's pictures ended: %s", how)
                raise DecodingFailed(how) from error

    def close(self) -> None:
        """End the process, also in the middle of a frame. Blocks for a moment."""
        self._closed = True
        if (process := self._process) is not None:
            process.kill()
        with self._guard:
            if self._process is not None:
                self._end(self._process)

    def _started(self) -> ConfinedProcess:
        if self._process is None:
            now_s = self._clock()
            if self._closed or now_s - self._started_s < RESTART_S:
                raise DecodingFailed("what decodes has ended")
            self._started_s, self._answered = now_s, False
            size = str(self._width), str(self._height)
            self._process = ConfinedProcess("services.live.look.confined", *size)
            if sys.platform == "linux":
                with suppress(OSError):  # its account has no more: answers come in pieces
                    fcntl.fcntl(self._process.output, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        return self._process

    def _decoded(
        self, process: ConfinedProcess, frames: Sequence[bytes]
    ) -> UInt8[Array, "H W 3"] | None:
        timeout_s = ANSWER_S if self._answered else START_S
        for number, data in enumerate(frames, 1):
            process.give(HEAD.pack(len(data), number == len(frames)) + data, timeout_s)
        answer = process.take(1, timeout_s)
        if not answer:
            raise BrokenPipeError
        pixels = self._pixels(process, timeout_s) if answer == PICTURE else None
        self._answered = True
        if answer == DAMAGED:
            raise DecodingFailed("the frames are damaged")
        return pixels

    def _pixels(self, process: ConfinedProcess, timeout_s: float) -> UInt8[Array, "H W 3"]:
        pixels = np.empty((self._height, self._width, 3), np.uint8)
        room = pixels.data.cast("B")
        if process.take_into(room, timeout_s) < len(room):
            raise BrokenPipeError
        return pixels

    def _end(self, process: ConfinedProcess) -> str:
        """Says how it ended, in words."""
        self._process = None
        with process:
            try:
                process.wait(_END_S)
            except TimeoutError:
                return "it did not answer"
            return process.how_ended()
