"""The process that decodes one sender's pictures for live look (services.confinement):

    python -m services.live.look.confined WIDTH HEIGHT

Frames (VP8) come by standard input, each behind its length in bytes and whether an answer is
wanted. An answer is a byte, and the newest frame's pixels (RGB) where that says PICTURE.
"""

from __future__ import annotations

import struct
import sys
from typing import TYPE_CHECKING

from services.confinement import Limits, confine

if TYPE_CHECKING:  # nothing is loaded before this process is confined
    from av import VideoFrame
    from av.video.reformatter import VideoReformatter

HEAD = struct.Struct("<I?")
PICTURE, NOTHING, DAMAGED = b"p", b"n", b"d"
"""The frames since the last answer: show a picture; show none of the right size; are damaged."""
LIMITS = Limits(memory_bytes=512 << 20, processor_s=4 * 3600, file_bytes=0, open_files=64)
"""A meeting of a day takes an hour of the processor's time."""


def main(width: int, height: int) -> None:
    """Decode until the input ends; frames of another size are none."""
    confine(LIMITS)
    from av import CodecContext, Packet
    from av.error import FFmpegError
    from av.video.codeccontext import VideoCodecContext
    from av.video.reformatter import VideoReformatter

    decoder: VideoCodecContext = CodecContext.create("libvpx", "r")
    decoder.thread_count = 1
    # one for all frames: each that makes its own works out anew how to
    reformatter = VideoReformatter()
    reading, shown, damaged = sys.stdin.buffer, None, False
    while len(head := reading.read(HEAD.size)) == HEAD.size:
        length, wanted = HEAD.unpack(head)
        try:
            for frame in decoder.decode(Packet(reading.read(length))):
                shown = frame
        except FFmpegError:
            damaged = True
        if wanted:
            answer = [DAMAGED] if damaged else _answer(shown, width, height, reformatter)
            sys.stdout.buffer.writelines(answer)
            sys.stdout.buffer.flush()
            shown, damaged = None, False


def _answer(
    frame: VideoFrame | None, width: int, height: int, reformatter: VideoReformatter
) -> list[bytes]:
    if frame is None or (frame.width, frame.height) != (width, height):
        return [NOTHING]
    plane = reformatter.reformat(frame, format="rgb24").planes[0]
    pixels, step = memoryview(plane), plane.line_size
    rows = (pixels[at : at + 3 * width] for at in range(0, height * step, step))
    return [PICTURE, b"".join(rows)]


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
