"""Frames as a page sends them for live look, and a sink that keeps what comes of them."""

from __future__ import annotations

import os
from fractions import Fraction
from pathlib import Path

import numpy as np
from aiortc import VideoStreamTrack
from av import CodecContext, VideoFrame
from av.video.codeccontext import VideoCodecContext

from scene.arrays import Array, UInt8
from services.live.cell_code import draw_cells
from services.live.look.keying import lifted
from services.live.look.picture import DroppedPictures, LookPicture, PoseRequest
from services.live.look.picture_code import SIDE_PX, PictureCode, cells_of
from services.live.look.receiver import FRAME_SIZE, PICTURE_PX

BITRATE = 250_000


def frame_of(code: PictureCode, rgb: UInt8[Array, "384 384 3"] | None = None) -> VideoFrame:
    """A frame whose person fills the middle of their picture; light blue unless `rgb` is given."""
    inside = np.zeros((PICTURE_PX, PICTURE_PX), bool)
    inside[96:288, 96:288] = True
    person = np.array([40, 90, 200], np.uint8) if rgb is None else rgb
    width, height = FRAME_SIZE
    pixels = np.zeros((height, width, 3), np.uint8)
    whole = np.broadcast_to(person, (PICTURE_PX, PICTURE_PX, 3))
    pixels[:PICTURE_PX] = lifted(whole, inside.astype(np.float32))
    # a page draws black and white; a coder makes 16 and 235 of them
    white = draw_cells(cells_of(code)) > 128
    pixels[PICTURE_PX:, :SIDE_PX] = 255 * white[..., None].astype(np.uint8)
    return VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format="yuv420p")


class Encoder:
    """VP8 at the bitrate that a page keeps to."""

    def __init__(self, size: tuple[int, int] = FRAME_SIZE) -> None:
        context: VideoCodecContext = CodecContext.create("libvpx", "w")
        context.width, context.height, context.pix_fmt = *size, "yuv420p"
        context.bit_rate, context.gop_size = BITRATE, 1000
        context.framerate, context.time_base = Fraction(15), Fraction(1, 15)
        context.options = {"deadline": "realtime", "cpu-used": "8", "lag-in-frames": "0"}
        self._context, self._pts = context, 0

    def encode(self, frame: VideoFrame) -> bytes:
        """The frame's bytes; of the first, a key frame's."""
        frame.pts, frame.time_base = self._pts, self._context.time_base
        self._pts += 1
        (packet,) = self._context.encode(frame)
        return bytes(packet)


class CodedPictures(VideoStreamTrack):
    """Pictures whose capture times count 40 ms on from one to the next."""

    def __init__(self, first_ms: int) -> None:
        super().__init__()
        self._captured_ms = first_ms

    async def recv(self) -> VideoFrame:
        """The next, at 30 a second."""
        pts, time_base = await self.next_timestamp()
        self._captured_ms = (self._captured_ms + 40) % 65536
        frame = frame_of(PictureCode(self._captured_ms, -20, 30, 360))
        frame.pts, frame.time_base = pts, time_base
        return frame


class KeptPictures(DroppedPictures):
    """Keeps what it is given, in order."""

    def __init__(self) -> None:
        self.pictures: list[LookPicture] = []
        self.requests: list[PoseRequest | None] = []
        self.stops = 0

    def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
        """Keep it."""
        self.pictures.append(picture)
        self.requests.append(request)

    def stop(self) -> None:
        """Count."""
        self.stops += 1


def decoding() -> list[int]:
    """The processes that decode for this one."""
    task = Path(f"/proc/{os.getpid()}/task")
    children = [int(one) for path in task.glob("*/children") for one in path.read_text().split()]
    command = "services.live.look.confined"
    return [one for one in children if command in Path(f"/proc/{one}/cmdline").read_text()]
