"""Renderers outside the gateway: as many as are needed, viewers placed by free capacity.

A meeting's viewers go to a renderer that draws it already, for they share pictures; else, of two
renderers drawn at random, to the one with more room (Mitzenmacher 2001); else one more begins.
Where all are at their limit a newcomer is refused, before anybody's pictures suffer; whoever is
inside already is drawn in any case. One renderer more than draw is kept warm: it takes over from
one that dies. With nobody to draw for, all of them end after a while.
"""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from prometheus_client import Counter, Gauge

from services.errors import RenderersAway, ServerFull
from services.live.aiortc_compat import MediaStreamError
from services.live.rendering.homes import RendererGone, RendererHome
from services.live.rendering.messages import pack
from services.live.rendering.outside_pictures import PicturesOutside, Slot
from services.live.room import Room
from services.live.streaming.encoding import Codec
from services.live.streaming.pacing import TICK_S
from services.live.streaming.pictures import Renderers

log = logging.getLogger(__name__)

RENDERERS = Gauge("metanerf_renderers", "Renderers outside the gateway, by state.", ["state"])
"""drawing; warm (for nobody); starting."""
LOST = Counter("metanerf_renderers_lost_total", "Renderers that ended without being told to.")
_LOOK_S = 1.0
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 30.0
"""Between two tries to start a renderer."""
_AWAY_S = 5
"""Until a newcomer may try again where no renderer starts, s."""


class RendererPool(Renderers):
    """Renderers of one home."""

    def __init__(
        self,
        home: RendererHome,
        clock: Callable[[], float],
        *,
        most: int,
        viewers_each: int,
        idle_s: float,
    ) -> None:
        """At most `most` draw, each for `viewers_each` viewers; they end after `idle_s` without
        any."""
        self._home, self._clock = home, clock
        self._most, self._viewers_each, self._idle_s = most, viewers_each, idle_s
        self._slots: list[Slot] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._keeping: asyncio.Task[None] | None = None
        self._used_s = -idle_s
        """When somebody was drawn for last."""
        self._fault = ""
        """Why a renderer could not be started."""

    @property
    def ready(self) -> bool:
        """See `Renderers.ready`."""
        return bool(self.ready_slots)

    @property
    def ready_slots(self) -> list[Slot]:
        """Places of the renderers that are warm."""
        return [slot for slot in self._slots if slot.ready]

    def __len__(self) -> int:
        """How many renderers there are, warm or not yet."""
        return len(self._slots)

    def warm_up(self) -> None:
        """See `Renderers.warm_up`."""
        self._used_s = self._clock()
        self._settle()

    def open(self, room: Room, codec: Codec) -> PicturesOutside:
        """See `Renderers.open`. Raises RenderersAway where none can be started."""
        pictures = PicturesOutside(room, codec, self)
        if not room.sealed:
            self._place(pictures, self._for_newcomer(room))
        return pictures

    async def slot_of(self, pictures: PicturesOutside) -> Slot:
        """See `Pool.slot_of`."""
        while not pictures.closed:
            slot = pictures.slot
            if slot is not None and slot.ready:
                return slot
            found = self._choose(pictures.room, self.ready_slots)
            if found is None and slot is None:
                found = self._least_drawing()
            if found is not None:
                self._place(pictures, found)
            if found is None or not found.ready:
                await asyncio.sleep(TICK_S)
        raise MediaStreamError

    def lose(self, slot: Slot, life: int, error: RendererGone) -> None:
        """See `Pool.lose`: it starts anew."""
        if slot.life != life or slot not in self._slots:
            return
        LOST.inc()
        log.warning("a renderer is lost, and starts anew: %s", error)
        slot.lose()
        self._start(slot)

    def release(self, pictures: PicturesOutside) -> None:
        """See `Pool.release`."""
        slot, key = pictures.slot, pictures.key
        if slot is not None:
            slot.remove(pictures)
            if slot.ready:
                self._run(slot.forget(key, pictures.room))

    async def close(self) -> None:
        """See `Renderers.close`."""
        for task in self._tasks:
            task.cancel()
        slots, self._slots = self._slots, []
        await asyncio.gather(*(slot.renderer.end() for slot in slots))
        await self._home.close()
        self._count()

    def _place(self, pictures: PicturesOutside, slot: Slot) -> None:
        self.release(pictures)
        slot.add(pictures)
        self._settle()

    def _for_newcomer(self, room: Room) -> Slot:
        ready = self.ready_slots
        starting = [slot for slot in self._slots if not slot.ready and not slot.broken]
        found = self._choose(room, ready) or self._choose(room, starting)
        broken = any(slot.broken for slot in self._slots)
        if found is None and not broken and self._drawing() < self._most:
            found = self._add()
        if found is not None:
            return found
        if not ready and not starting:
            raise RenderersAway(f"what draws must run; got none: {self._fault}", _AWAY_S)
        raise ServerFull(
            f"at most {self._most} renderers draw here, each for {self._viewers_each} viewers or "
            "fewer if it is busy; got one viewer more; try again"
        )

    def _choose(self, room: Room, among: Sequence[Slot]) -> Slot | None:
        """Where there is a place for a viewer of `room`."""
        drawing = [slot for slot in among if slot.pictures and slot.free > 0]
        same = [slot for slot in drawing if slot.draws(room)]
        if drawing:
            two = same or random.sample(drawing, min(2, len(drawing)))
            return max(two, key=lambda slot: slot.free)
        unused = [slot for slot in among if not slot.pictures]
        return unused[0] if unused and self._drawing() < self._most else None

    def _least_drawing(self) -> Slot | None:
        """For somebody who is inside: over its limit, or not warm yet, but better than nothing."""
        usable = [slot for slot in self._slots if not slot.broken]
        return min(usable, key=lambda slot: (not slot.ready, len(slot.pictures)), default=None)

    def _drawing(self) -> int:
        return sum(bool(slot.pictures) for slot in self._slots)

    def _settle(self) -> None:
        """Have as many renderers as are wanted."""
        now_s, drawing = self._clock(), self._drawing()
        if drawing:
            self._used_s = now_s
        wanted = drawing + 1 if drawing or now_s - self._used_s < self._idle_s else 0
        while len(self._slots) < wanted:
            self._add()
        unused = [slot for slot in self._slots if not slot.pictures]
        for slot in unused[: len(self._slots) - wanted]:
            if slot.broken or now_s - slot.idle_s >= self._idle_s:
                self._slots.remove(slot)
                self._run(slot.renderer.end())
        if self._keeping is None:
            self._keeping = self._run(self._keep())
        self._count()

    def _add(self) -> Slot:
        slot = Slot(self._home.renderer(), self._clock, self._viewers_each)
        self._slots.append(slot)
        self._start(slot)
        return slot

    def _start(self, slot: Slot) -> None:
        self._run(self._started(slot))

    async def _started(self, slot: Slot) -> None:
        pause_s = _FIRST_PAUSE_S
        while slot in self._slots:
            try:
                await slot.renderer.start()
                slot.warm()
                return
            except RendererGone as error:
                if slot not in self._slots:  # ended meanwhile, as it was told
                    return
                slot.broken, self._fault = True, str(error)
                log.error("a renderer could not be started: %s", error)
            for one in list(slot.pictures):
                self.release(one)
            await asyncio.sleep(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)

    async def _keep(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_S)
            self._settle()
            for slot in self._slots:
                # those that draw are missed as soon as they are gone
                if slot.ready and not slot.pictures and not slot.lock.locked():
                    self._run(self._check(slot))

    async def _check(self, slot: Slot) -> None:
        life = slot.life
        try:
            async with slot.lock:
                await slot.renderer.draw(pack({"act": "ping"}))
        except RendererGone as error:
            self.lose(slot, life, error)

    def _run(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _count(self) -> None:
        warm = sum(slot.ready and not slot.pictures for slot in self._slots)
        drawing = sum(slot.ready and bool(slot.pictures) for slot in self._slots)
        for state, count in (("drawing", drawing), ("warm", warm)):
            RENDERERS.labels(state).set(count)
        RENDERERS.labels("starting").set(len(self._slots) - drawing - warm)
