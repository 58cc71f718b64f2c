"""The process of one renderer: `python -m services.live.rendering.child FORMAT LEVEL NODE_ID`,
which says how it logs (services.logs).

Requests come by standard input, answers go by standard output; the gateway's end of either tells
when it is gone, however it ended, and so the process ends. It has no settings, no secrets and no
way to the stores.

A request is u32 length, u32 number and u8 lane, then its bytes; an answer u32 length and u32
number, then its bytes (little endian). Requests of one lane are answered in their order; with the
first answer of the lane `DRAW` the renderer is warm.
"""

from __future__ import annotations

import os
import signal
import struct
import sys
import threading
from enum import IntEnum
from queue import SimpleQueue
from typing import BinaryIO

from services import logs

REQUEST = struct.Struct("<IIB")
ANSWER = struct.Struct("<II")


class Lane(IntEnum):
    """What goes on beside each other."""

    DRAW = 0
    LOAD = 1


Requests = SimpleQueue[tuple[int, bytes]]


def main() -> None:
    """Answer until the gateway is gone."""
    # who prints must not write among the answers
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb", buffering=0)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    # the gateway goes on drawing while it drains, and ends this process itself
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)
    logs.configure(logs.LogStyle(*sys.argv[1:]))
    lanes: dict[Lane, Requests] = {lane: SimpleQueue() for lane in Lane}
    threading.Thread(target=_read, args=(lanes,), daemon=True).start()

    from renderer.scene_renderer import warm_up
    from services.live.rendering.stage import RenderStage

    stage, writing = RenderStage(), threading.Lock()

    def serve(lane: Lane) -> None:
        while True:
            number, request = lanes[lane].get()
            answer = stage.answer(request)
            with writing:
                _write(answers, ANSWER.pack(len(answer), number) + answer)

    warm_up()
    threading.Thread(target=serve, args=(Lane.LOAD,), daemon=True).start()
    serve(Lane.DRAW)


def _read(lanes: dict[Lane, Requests]) -> None:
    while len(head := _taken(REQUEST.size)) == REQUEST.size:
        length, number, lane = REQUEST.unpack(head)
        lanes[Lane(lane)].put((number, _taken(length)))
    os._exit(os.EX_OK)  # whatever it does: nobody waits for it


def _taken(count: int) -> bytes:
    """The next bytes, fewer at the end; unbuffered: a lock would be held at the end."""
    parts, left = list[bytes](), count
    while left and (part := os.read(sys.stdin.fileno(), left)):
        parts.append(part)
        left -= len(part)
    return b"".join(parts)


def _write(answers: BinaryIO, data: bytes) -> None:
    left = memoryview(data)
    try:
        while left:
            left = left[answers.write(left) :]
    except BrokenPipeError:
        os._exit(os.EX_OK)


if __name__ == "__main__":
    main()
