"""A viewer's pictures, drawn and encoded by a renderer outside this process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from services.live.rendering.homes import RendererGone
from services.live.rendering.messages import order_header, pack, picture_of, unpack
from services.live.rendering.slot import Slot
from services.live.room import Room
from services.live.streaming.encoding import Codec
from services.live.streaming.pictures import (
    CodedPicture,
    PictureOrder,
    PictureRefused,
    ViewerPictures,
)


class Pool(Protocol):
    """Finds renderers."""

    async def slot_of(self, pictures: PicturesOutside) -> Slot:
        """The warm renderer that draws these pictures. Raises MediaStreamError once they were
        closed."""
        ...

    def lose(self, slot: Slot, life: int, error: RendererGone) -> None:
        """The renderer is gone that was there in this life of its place."""
        ...

    def release(self, pictures: PicturesOutside) -> None:
        """Nothing is drawn for them now."""
        ...


class PicturesOutside(ViewerPictures):
    """One viewer's. Of its pictures one at most is on its way, and of a renderer's too: what is
    sent next is as new as it can be."""

    def __init__(self, room: Room, codec: Codec, pool: Pool) -> None:
        self.room, self._codec, self._pool = room, codec, pool
        self.slot: Slot | None = None
        """Which renderer has a place for them."""
        self.key = ""
        """By which that renderer knows them."""
        self.closed = False

    async def picture(self, order: Callable[[], PictureOrder]) -> CodedPicture:
        """See `ViewerPictures.picture`."""
        while True:
            slot = await self._pool.slot_of(self)
            life = slot.life
            try:
                await slot.staging.prepare(self.room)
                async with slot.lock:
                    picture = await self._drawn_by(slot, order)
            except RendererGone as error:
                self._pool.lose(slot, life, error)
                continue
            if picture is not None:
                return picture

    def rest(self) -> None:
        """See `ViewerPictures.rest`."""
        self._pool.release(self)

    def close(self) -> None:
        """See `ViewerPictures.close`."""
        self.closed = True
        self._pool.release(self)

    async def _drawn_by(self, slot: Slot, order: Callable[[], PictureOrder]) -> CodedPicture | None:
        """None where the renderer is no longer theirs, or does not know the room any more."""
        room = slot.staging.of(self.room)
        if room is None or self.slot is not slot:
            return None
        made = order()
        about = {"act": "picture", "room": room.key, "viewer": self.key, "codec": self._codec}
        request = pack(about | order_header(made), room.poses(made.tick, made.now_s))
        header, parts = unpack(await slot.renderer.draw(request))
        if "refused" in header:
            raise PictureRefused(header["refused"])
        if "unknown" in header:  # started anew without a word
            slot.staging.lost(self.room)
            return None
        picture = picture_of(header, parts, made.tick)
        slot.note(picture.draw_s + picture.encode_s)
        return picture
