"""A film in a webcam's place, and what the server keeps of it: landmarks, packets, live motion,
cut-outs, VP8, the process that decodes, and the choosing, all of them the product's own.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Self

from av import VideoFrame

from benchmarks.lifelike_look.webcam import packet_of
from renderer.live_look.frame_keeper import KeptFrame
from renderer.splats.model import SplatModel
from scene.arrays import Array, UInt8
from scene.errors import InvalidInput
from services.joining.cut_out import CutOut
from services.joining.finder import PersonFinder
from services.joining.look_track import BITRATE, SPEED
from services.live.look.decoder import LookDecoder
from services.live.look.receiver import FRAME_SIZE, picture_of
from services.live.motion.live_looks import PerformerLook
from services.live.motion.live_motion import LiveMotion
from services.live.streaming.encoding import FRAMES_PER_SECOND, Codec, PictureEncoder

_BETWEEN_S = 5.0
"""From one film to the next."""


class ServedWebcam:
    """One performer, whose pictures are kept. Use as a context manager."""

    def __init__(self, model: SplatModel) -> None:
        self._motion, self._now_s, self._number = LiveMotion(model.skeleton), _BETWEEN_S, 0
        self._executor = ThreadPoolExecutor(max_workers=1)
        self._look = PerformerLook(self._motion, self._executor, lambda: self._now_s)
        self._look.keeping.start(model)
        self._decoder = LookDecoder(FRAME_SIZE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self._decoder.close()
        self._executor.shutdown()

    @property
    def kept(self) -> list[KeptFrame]:
        """What is kept so far."""
        return self._look.keeping.frames

    def play(
        self, finder: PersonFinder, film: Iterable[tuple[float, UInt8[Array, "H W 3"]]]
    ) -> int:
        """Have the server see a film, of seconds and sRGB pictures; how many it got to see."""
        cut_out, coder, sent, start_s = CutOut(), PictureEncoder(Codec.VP8, SPEED), 0, self._now_s
        for time_s, image in film:
            self._now_s = start_s + time_s
            time_ms = 1e3 * self._now_s
            if (found := finder.find(image)) is None:
                continue
            self._number += 1
            try:
                self._motion.update(packet_of(image, found, self._number, time_ms), self._now_s)
            except InvalidInput:  # too little is seen
                continue
            frame = cut_out.draw(image, found.body, time_ms)
            if frame is None:
                continue
            yuv = VideoFrame.from_ndarray(frame, format="rgb24").reformat(format="yuv420p")
            tick = round(FRAMES_PER_SECOND * self._now_s)
            packet = coder.encode(yuv, tick, BITRATE, key=not sent)
            if not packet.size:  # left out, to keep to the bitrate
                continue
            pixels = self._decoder.newest([bytes(packet)])
            picture = None if pixels is None else picture_of(pixels)
            if picture is None:
                continue
            sent += 1
            self._look.receive(picture)
            self._executor.submit(lambda: None).result()  # behind the picture
        self._look.stop()
        self._now_s += _BETWEEN_S
        return sent
