"""A viewer's pictures, drawn and encoded by a renderer outside this process, and the place of such
a renderer: who is drawn there, how busy it is, whether it is warm."""

from __future__ import annotations

import asyncio
import secrets
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from services.live.rendering.homes import Renderer, RendererGone
from services.live.rendering.messages import order_header, pack, picture_of, unpack
from services.live.rendering.staging import Staging
from services.live.room import Room
from services.live.streaming.encoding import Codec
from services.live.streaming.pictures import (
    CodedPicture,
    PictureOrder,
    PictureRefused,
    ViewerPictures,
)

_WINDOW_S = 4.0
_OVERLOADED_SHARE = 0.85
"""Of its time: a renderer that draws for longer takes nobody more, however few it draws for."""


class Slot:
    """A place for a renderer, which may be lost and start anew."""

    def __init__(self, renderer: Renderer, clock: Callable[[], float], viewers: int) -> None:
        """For so many viewers."""
        self.renderer, self.staging = renderer, Staging(renderer)
        self.lock = asyncio.Lock()
        """Held for one picture: while others wait, their state may still become newer."""
        self.pictures: set[PicturesOutside] = set()
        self.ready, self.broken = False, False
        """Whether it is warm; whether it could not be started. Neither: it starts."""
        self.life = 0
        """How often it was lost."""
        self.idle_s = clock()
        """Since when it draws for nobody."""
        self._clock, self._viewers = clock, viewers
        self._work: deque[tuple[float, float]] = deque()

    @property
    def free(self) -> int:
        """How many more viewers it takes."""
        since_s = self._clock() - _WINDOW_S
        while self._work and self._work[0][0] < since_s:
            self._work.popleft()
        busy_s = sum(work_s for _, work_s in self._work)
        overloaded = busy_s > _OVERLOADED_SHARE * _WINDOW_S
        return 0 if overloaded else max(0, self._viewers - len(self.pictures))

    def draws(self, room: Room) -> bool:
        """Whether it draws that room for somebody."""
        return any(one.room is room for one in self.pictures)

    def note(self, work_s: float) -> None:
        """A picture has just been made that took so long."""
        self._work.append((self._clock(), work_s))

    def add(self, pictures: PicturesOutside) -> None:
        """Have it draw these too. What it may know of them from before counts no more: the first
        needs none before it."""
        self.pictures.add(pictures)
        pictures.slot, pictures.key = self, secrets.token_hex(8)

    def remove(self, pictures: PicturesOutside) -> None:
        """It draws them no longer, and forgets what it knew for them alone."""
        self.pictures.discard(pictures)
        pictures.slot, self.idle_s = None, self._clock()

    def warm(self) -> None:
        """It has started."""
        self.ready, self.broken, self.idle_s = True, False, self._clock()

    def lose(self) -> None:
        """It is gone, and all that it knew."""
        self.ready, self.life = False, self.life + 1
        for one in list(self.pictures):
            self.remove(one)
        self.staging.lose_all()
        self._work.clear()

    async def forget(self, viewer: str, room: Room) -> None:
        """Have it forget a viewer, and their room if nobody else there looks at it."""
        async with self.lock:
            rooms = [] if self.draws(room) else self.staging.take(room)
            with suppress(RendererGone):
                await self.renderer.draw(
                    pack({"act": "forget", "viewers": [viewer], "rooms": rooms})
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
