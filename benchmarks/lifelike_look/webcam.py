"""A lifelike performer's webcam, from its picture to what the server makes of it: the product's own
landmarks, packets, live motion, cut-outs and VP8.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import av
import numpy as np
from av import VideoFrame

from benchmarks.lifelike_look.performances import PLAYED_HZ, Performance
from capture.studio.room import room_background
from renderer.live_look.picture import WebcamPicture
from scene.arrays import Array, UInt8
from scene.camera import Camera
from scene.sequence import Frame
from scene.skeleton import Skeleton
from services.joining.cut_out import CutOut
from services.joining.finder import FoundPerson, PersonFinder
from services.joining.look_track import BITRATE, SPEED
from services.live.keypoints_packet import KeypointsPacket, decode_keypoints, encode_keypoints
from services.live.look.receiver import picture_of
from services.live.motion.live_looks import seen_of
from services.live.motion.live_motion import LiveMotion
from services.live.streaming.encoding import FRAMES_PER_SECOND, Codec, PictureEncoder

_ROOM_SEED = 3
_FIRST_MS = 1000.0
_SUPERSAMPLING = 2
"""A picture becomes smaller before it is sent."""


@dataclass(frozen=True)
class GivenTruth:
    """What is known exactly, in place of what is found: to find a figure's cause."""

    pose: bool = False
    matte: bool = False
    coding: bool = False
    """Pictures as they were cut out, not as VP8 leaves them."""


AS_FOUND = GivenTruth()


@dataclass(frozen=True, eq=False)
class SeenPicture:
    """One picture of the webcam, as the server has it."""

    number: int
    """Of the pose in the performance's motion."""
    picture: WebcamPicture
    camera: Camera
    """Of the webcam's whole picture, in the world of the picture's pose."""


class SyntheticWebcam:
    """Films one performance."""

    def __init__(
        self, performance: Performance, finder: PersonFinder, given: GivenTruth = AS_FOUND
    ) -> None:
        self._performance, self._finder, self._given = performance, finder, given
        self._room = room_background(performance.webcam, _ROOM_SEED)

    def pictures(self, skeleton: Skeleton) -> Iterator[SeenPicture]:
        """What comes of the performance for a model of `skeleton`, in order, 10 a second."""
        live, cut_out = LiveMotion(skeleton), CutOut()
        coder, decoder = PictureEncoder(Codec.VP8, SPEED), av.CodecContext.create("libvpx", "r")
        for number in range(len(self._performance.motion)):
            truth = self._performance.truth(number, supersampling=_SUPERSAMPLING)
            time_ms = _FIRST_MS + 1e3 * number / PLAYED_HZ
            image = self._filmed(truth)
            found = self._finder.find(image)
            if found is None:
                continue
            live.update(packet_of(image, found, number, time_ms), 1e-3 * time_ms)
            body = replace(found.body, mask=truth.mask) if self._given.matte else found.body
            frame = cut_out.draw(image, body, time_ms)
            if frame is None:
                continue
            sent = VideoFrame.from_ndarray(frame, format="rgb24")
            if not self._given.coding:
                tick = round(FRAMES_PER_SECOND * number / PLAYED_HZ)
                packet = coder.encode(
                    sent.reformat(format="yuv420p"), tick, BITRATE, key=not number
                )
                if not packet.size:
                    continue
                (sent,) = decoder.decode(packet)
            picture, solved = picture_of(sent.to_ndarray(format="rgb24")), live.solved(time_ms)
            if picture is not None and solved is not None:
                pose, camera = solved.pose, solved.camera
                if self._given.pose:
                    pose, camera = replace(truth.pose, time_s=pose.time_s), truth.camera
                yield SeenPicture(number, seen_of(picture, camera, pose), camera)

    def _filmed(self, truth: Frame) -> UInt8[Array, "H W 3"]:
        image = truth.image + (1.0 - truth.mask[..., None]) * self._room
        return (255.0 * np.clip(image, 0.0, 1.0) + 0.5).astype(np.uint8)


def packet_of(
    image: UInt8[Array, "H W 3"], found: FoundPerson, number: int, time_ms: float
) -> KeypointsPacket:
    """As it arrives."""
    size = (image.shape[1], image.shape[0])
    body, expression, head = found
    packet = KeypointsPacket(
        number,
        time_ms,
        *size,
        body.pixels / size,
        body.world,
        body.visibility,
        expression if expression.known else None,
        live_look=True,
        head=head,
    )
    return decode_keypoints(encode_keypoints(packet))
