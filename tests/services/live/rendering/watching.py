"""Rooms to draw, and viewers of them without a network."""

from __future__ import annotations

import asyncio
import itertools
from dataclasses import fields
from pathlib import Path

import numpy as np
from av import CodecContext, Packet, VideoFrame

from renderer.performer_model import PerformerModel
from renderer.splats.model import SplatModel
from scene.arrays import Array
from services.live.rendering.messages import pack, unpack
from services.live.rendering.outside_pictures import PicturesOutside, Slot
from services.live.rendering.pool import RendererPool
from services.live.room import MeetingPerformer, Room
from services.live.streaming.encoding import Codec
from services.live.streaming.pictures import PictureOrder
from tests.renderer.studio import make_model, make_motion

_PX = 128


def a_room(*models: PerformerModel, name: str = "m") -> Room:
    """A room of these people, or of one."""
    people = enumerate(models or (make_model(),))
    return Room(
        name,
        tuple(
            MeetingPerformer(f"p{at}", f"Ada {at}", one, make_motion(20), (0.8 * at, 0.0, 0.0), 0.3)
            for at, one in people
        ),
    )


class HalfModel(SplatModel):
    """A model whose file is not whole."""

    @classmethod
    def made(cls) -> HalfModel:
        """Of somebody in the studio."""
        whole = make_model()
        return cls(**{one.name: getattr(whole, one.name) for one in fields(whole)})

    def tensors(self) -> dict[str, Array]:
        """All but one."""
        return dict(list(super().tensors().items())[1:])


class Watcher:
    """Orders pictures of a room and decodes them."""

    def __init__(self, pool: RendererPool, room: Room) -> None:
        """Raises ServerFull."""
        self.pictures: PicturesOutside = pool.open(room, Codec.H264)
        self._room, self._ticks = room, itertools.count()
        self._decoder = CodecContext.create("h264", "r")

    @property
    def slot(self) -> Slot:
        """Of the renderer that draws for them."""
        assert self.pictures.slot is not None
        return self.pictures.slot

    def order(self, *, tick: int | None = None, key: bool = False) -> PictureOrder:
        """The next picture."""
        tick = next(self._ticks) if tick is None else tick
        camera = self._room.initial_camera(_PX, _PX)
        return PictureOrder(tick, tick / 30.0, camera, False, 1.0, 2_500_000, key)

    async def packet(self) -> Packet:
        """The next picture, as it would be sent."""
        made = await asyncio.wait_for(self.pictures.picture(self.order), 300.0)
        return made.packet

    async def shown(self) -> Array:
        """The next picture, as it is seen: H x W x 3."""
        (frame,) = self._decoder.decode(await self.packet())
        assert isinstance(frame, VideoFrame)
        return frame.to_ndarray(format="rgb24").astype(np.int32)


async def process_of(slot: Slot) -> int:
    """The id of a renderer's process."""
    async with slot.lock:
        answer, _ = unpack(await slot.renderer.draw(pack({"act": "ping"})))
    return answer["process_id"]


def is_gone(process_id: int) -> bool:
    """Whether a process has ended."""
    return not Path(f"/proc/{process_id}/cwd").exists()
