"""Pictures drawn by a thread of this process: the home that needs nothing else."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from weakref import WeakKeyDictionary

from renderer.performer_model import PerformerModel
from renderer.scene_renderer import warm_up
from scene.environment import Scene
from services.live.rendering.drawing import RoomPictures, ViewerDrawing, Workload
from services.live.room import Room
from services.live.streaming.encoding import Codec, PictureEncoder
from services.live.streaming.pictures import (
    CodedPicture,
    PictureOrder,
    Renderers,
    ViewerPictures,
)

log = logging.getLogger(__name__)


class RenderersHere(Renderers):
    """One thread draws and encodes for all viewers in turn: a picture already uses every core."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="render")
        self._workload = Workload()
        self._pictures: WeakKeyDictionary[Room, RoomPictures] = WeakKeyDictionary()
        self._warming_up: Future[None] | None = None

    @property
    def ready(self) -> bool:
        """See `Renderers.ready`: on its first start on a machine the renderer compiles."""
        return self._warming_up is None or self._warming_up.done()

    def warm_up(self) -> None:
        """See `Renderers.warm_up`."""
        self._warming_up = self._executor.submit(warm_up)
        self._warming_up.add_done_callback(_log_failure)

    def open(self, room: Room, codec: Codec) -> ViewerPictures:
        """See `Renderers.open`: the sessions' own limit is the only one."""
        pictures = self._pictures.setdefault(room, RoomPictures())
        drawing = ViewerDrawing(PictureEncoder(codec), self._workload, self._clock)
        return PicturesHere(room, pictures, drawing, self._executor)

    async def close(self) -> None:
        """See `Renderers.close`."""
        self._executor.shutdown(wait=False)


class PicturesHere(ViewerPictures):
    """One viewer's, drawn on the thread of `executor`."""

    def __init__(
        self, room: Room, pictures: RoomPictures, drawing: ViewerDrawing, executor: Executor
    ) -> None:
        self._room, self._pictures = room, pictures
        self._drawing, self._executor = drawing, executor

    async def picture(self, order: Callable[[], PictureOrder]) -> CodedPicture:
        """See `ViewerPictures.picture`."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._executor, self._draw, order)

    def rest(self) -> None:
        """See `ViewerPictures.rest`."""
        self._drawing.release()

    def close(self) -> None:
        """See `ViewerPictures.close`: nothing outlives the viewer."""

    def _draw(self, make_order: Callable[[], PictureOrder]) -> CodedPicture:
        order = make_order()

        def scene() -> Scene[PerformerModel]:
            return self._room.scene_at(order.now_s, hide_unseen=order.hide_unseen, live_look=True)

        return self._drawing.picture(self._pictures, order, scene)


def _log_failure(warming_up: Future[None]) -> None:
    if not warming_up.cancelled() and (error := warming_up.exception()):
        log.error("the renderer could not be prepared", exc_info=error)
