"""Pictures of a webcam as they come out of the line: cut out, coded by VP8 and decoded again."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Many
from dataclasses import replace

import av
import numpy as np
from av import VideoFrame

from renderer.live_look.picture import WebcamPicture
from scene.arrays import Array, UInt8
from services.joining.look_track import BITRATE, SPEED
from services.live.look.keying import lifted, lowered
from services.live.look.receiver import FRAME_SIZE
from services.live.streaming.encoding import FRAMES_PER_SECOND, Codec, PictureEncoder

PICTURES_A_SECOND = 10.0
_TICKS = round(FRAMES_PER_SECOND / PICTURES_A_SECOND)


def sent(pictures: Many[WebcamPicture]) -> Iterator[WebcamPicture]:
    """`pictures`, of at most 384 px, as the server gets them.

    They are on the line backwards first: whoever is seen for the first time is coded worse than
    whoever has been there for a while.
    """
    coder, decoder = PictureEncoder(Codec.VP8, SPEED), av.CodecContext.create("libvpx", "r")
    shown: UInt8[Array, "528 384 3"] | None = None
    order = [*reversed(pictures), *pictures]
    for number, picture in enumerate(order):
        frame = VideoFrame.from_ndarray(_frame(picture), format="rgb24").reformat(format="yuv420p")
        packet = coder.encode(frame, _TICKS * number, BITRATE, key=not number)
        # the coder leaves one out now and then: the one before it stays
        if packet.size:
            shown = decoder.decode(packet)[0].to_ndarray(format="rgb24")
        if number >= len(pictures):
            assert shown is not None
            yield _of_frame(shown, picture)


def _frame(picture: WebcamPicture) -> UInt8[Array, "528 384 3"]:
    """As `services.joining.cut_out` draws it, but for the code."""
    height, width = picture.matte.shape
    columns, rows = FRAME_SIZE
    frame = np.zeros((rows, columns, 3), np.uint8)
    kept = np.minimum(2.0 / 255.0 * picture.matte.astype(np.float32), 1.0)
    frame[:height, :width] = lifted(picture.rgb, kept)
    return frame


def _of_frame(frame: UInt8[Array, "528 384 3"], picture: WebcamPicture) -> WebcamPicture:
    """What `frame` shows of `picture`."""
    height, width = picture.matte.shape
    rgb, matte = lowered(frame[:height, :width])
    return replace(picture, rgb=rgb, matte=matte)
