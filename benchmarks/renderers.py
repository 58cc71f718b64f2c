"""What it costs to draw for a viewer outside the gateway, and how soon one that dies is replaced.

One viewer who stands still looks at one person, 512 x 512 px, thirty pictures a second, drawn by
the gateway's own thread and by a child process. *On the way* is what a picture takes from the order
to the packet beyond drawing and encoding. Then the process that draws is killed.
"""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.reporting.figures import FigureWriter
from renderer.model_files import load_model
from services.bootstrap import DEMO_MODEL
from services.live.packets import NewestView
from services.live.rendering.here import RenderersHere
from services.live.rendering.messages import pack, unpack
from services.live.rendering.pool import RendererPool
from services.live.rendering.processes import ProcessHome
from services.live.room import MeetingPerformer, Room
from services.live.streaming.encoding import Codec
from services.live.streaming.instrumentation import Instrumentation
from services.live.streaming.pictures import (
    CodedPicture,
    PictureOrder,
    Renderers,
    ViewerPictures,
)
from services.live.streaming.view_track import ViewTrack

_WARM_UPS, _TURNS, _PICTURES, _KILLS = 3, 20, 300, 5
_IDLE_S = 600.0
_WAITS_S = 0.1


class _Timed(ViewerPictures):
    """Notes what each picture took, in all and to draw and encode."""

    def __init__(self, pictures: ViewerPictures) -> None:
        self._pictures = pictures
        self.made_s: list[float] = []
        self.on_the_way_s: list[float] = []

    async def picture(self, order: Callable[[], PictureOrder]) -> CodedPicture:
        ordered_s = 0.0

        def noted() -> PictureOrder:
            nonlocal ordered_s
            ordered_s = time.perf_counter()
            return order()

        picture = await self._pictures.picture(noted)
        made_s = picture.draw_s + picture.encode_s
        self.made_s.append(made_s)
        self.on_the_way_s.append(time.perf_counter() - ordered_s - made_s)
        return picture

    def forget(self) -> None:
        """What was noted so far does not count."""
        self.made_s.clear()
        self.on_the_way_s.clear()

    def rest(self) -> None:
        self._pictures.rest()

    def close(self) -> None:
        self._pictures.close()


def run(writer: FigureWriter) -> None:
    """Measure and report."""
    writer.write(asyncio.run(_measured()))


async def _measured() -> dict[str, Any]:
    """Both homes by turns, so that what else the machine does is shared alike."""
    room = Room("", (MeetingPerformer.at_place("ada", "Ada", load_model(DEMO_MODEL), 0),))
    pool = RendererPool(ProcessHome(1), time.monotonic, most=1, viewers_each=1, idle_s=_IDLE_S)
    homes: dict[str, Renderers] = {"here": RenderersHere(time.monotonic), "processes": pool}
    watched = {}
    for name, renderers in homes.items():
        renderers.warm_up()
        while not renderers.ready:
            await asyncio.sleep(_WAITS_S)
        pictures = _Timed(renderers.open(room, Codec.H264))
        track = ViewTrack(room, pictures, NewestView(), Instrumentation(), time.monotonic)
        watched[name] = pictures, track
    while len(pool.ready_slots) < 2:  # the one that waits starts meanwhile
        await asyncio.sleep(_WAITS_S)
    for turn in range(-_WARM_UPS, _TURNS):
        for pictures, track in watched.values():
            for _ in range(_PICTURES // _TURNS):
                await track.recv()
            if turn < 0:
                pictures.forget()
    rows = [_row(name, pictures) for name, (pictures, _) in watched.items()]
    rows[1]["again_s"] = [await _again(pool, watched["processes"][1]) for _ in range(_KILLS)]
    for row in rows:
        print(row, flush=True)
    for name, renderers in homes.items():
        watched[name][1].stop()
        await renderers.close()
    return {"pictures": _PICTURES, "kills": _KILLS, "rows": rows}


def _row(name: str, pictures: _Timed) -> dict[str, Any]:
    row: dict[str, Any] = {"home": name}
    for what, seconds in (("made", pictures.made_s), ("way", pictures.on_the_way_s)):
        for share in (50, 95):
            row[f"{what}_p{share}_ms"] = round(1e3 * float(np.percentile(seconds, share)), 2)
    return row | {"again_s": []}


async def _again(pool: RendererPool, track: ViewTrack) -> float:
    """From the end of the process that draws to the next picture, s."""
    while len(pool.ready_slots) < 2:
        await track.recv()
    (slot,) = (one for one in pool.ready_slots if one.pictures)
    answer, _ = unpack(await slot.renderer.draw(pack({"act": "ping"})))
    os.kill(answer["process_id"], signal.SIGKILL)
    killed_s = time.monotonic()
    while not (await track.recv()).is_keyframe:
        pass
    return round(time.monotonic() - killed_s, 2)
