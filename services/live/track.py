"""A viewer's own video: the newest pose and the newest camera in, one picture out.

Frames are dropped, never queued: each picture starts when it is due or, if late, at once.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor
from fractions import Fraction
from typing import cast

import numpy as np
from aiortc import MediaStreamTrack
from av import VideoFrame
from av.video.plane import VideoPlane

from renderer.stage import Stage
from scene.arrays import Array, UInt8
from scene.camera import Camera
from services.live.packets import NewestView
from services.live.poses import left_to_viewer
from services.live.room import Room

FRAMES_PER_SECOND = 30
_CLOCK_RATE = 90_000
_TIME_BASE = Fraction(1, _CLOCK_RATE)
_SMALLEST_PX, _LARGEST_PX = 128, 1024
_DEFAULT_SIZE = (512, 512)
_BLOCK_PX = 16
"""VP8 codes macroblocks of 16 x 16; other sizes would be padded by the encoder."""


class ViewTrack(MediaStreamTrack):
    """Renders what one viewer sees of `room`."""

    kind = "video"

    def __init__(
        self,
        room: Room,
        view: NewestView,
        stage: Stage,
        executor: Executor,
        clock: Callable[[], float],
    ) -> None:
        super().__init__()
        self.render_seconds: deque[float] = deque(maxlen=300)
        """Time of the last renders, s, for the metrics."""
        self._room, self._view, self._stage = room, view, stage
        self._executor, self._clock = executor, clock
        self._due_s: float | None = None
        self._start_s = clock()

    async def recv(self) -> VideoFrame:
        """The next picture, rendered when it is due (30 a second) from the newest state.

        None comes while the viewer draws the room: nothing is rendered, encoded or sent then.
        """
        while left_to_viewer(self._room, self._view):
            await asyncio.sleep(1.0 / FRAMES_PER_SECOND)
        now = self._clock()
        due = now if self._due_s is None else self._due_s
        if due > now:
            await asyncio.sleep(due - now)
        started = self._clock()
        frame = await asyncio.get_running_loop().run_in_executor(
            self._executor, self._picture, started
        )
        self.render_seconds.append(self._clock() - started)
        self._due_s = max(due + 1.0 / FRAMES_PER_SECOND, self._clock() - 1.0 / FRAMES_PER_SECOND)
        frame.pts = int((started - self._start_s) * _CLOCK_RATE)
        frame.time_base = _TIME_BASE
        return frame

    def _picture(self, now_s: float) -> VideoFrame:
        packet = self._view.packet
        hide_unseen = packet is not None and packet.hide_unseen
        scene = self._room.scene_at(now_s, hide_unseen=hide_unseen)
        return video_frame(self._stage.render(scene, self._camera()))

    def _camera(self) -> Camera:
        packet = self._view.packet
        if packet is None:
            return self._room.first_view(*_DEFAULT_SIZE)
        return packet.camera(*frame_size(packet.width, packet.height))


def video_frame(picture: UInt8[Array, "H W 3"]) -> VideoFrame:
    """`picture` (sRGB, even sides) as the encoder takes it: written once, straight into its planes.

    Going through an RGB frame would copy it and have the encoder convert it on one core.
    """
    from renderer.yuv_kernels import to_yuv420  # numba takes a second

    height, width = picture.shape[:2]
    frame = VideoFrame(width, height, "yuv420p")
    to_yuv420(picture, *(_rows(plane) for plane in frame.planes))
    return frame


def _rows(plane: VideoPlane) -> UInt8[Array, "H S"]:
    """The plane's own bytes, to be written."""
    memory = cast(memoryview, plane)  # PyAV's types do not say that planes are buffers
    return np.frombuffer(memory, np.uint8).reshape(plane.height, plane.line_size)


def frame_size(width: int, height: int) -> tuple[int, int]:
    """The size to render for a viewer who asks for `width` x `height` px.

    Aspect kept, the longest side at most 1024 px, both sides multiples of 16 and at least 128 px.
    """
    if width < 1 or height < 1:
        return _DEFAULT_SIZE
    scale = min(1.0, _LARGEST_PX / max(width, height))
    sides = (
        max(_SMALLEST_PX, round(side * scale / _BLOCK_PX) * _BLOCK_PX) for side in (width, height)
    )
    wide, high = sides
    return wide, high
