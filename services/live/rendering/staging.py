"""A renderer learns of rooms: what it draws stays as it is until it has read what came new."""

from __future__ import annotations

import asyncio
import logging
import secrets
from dataclasses import replace
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from renderer.performer_model import PerformerModel
from scene.environment import Environment
from services.live.packets import PosePacket, encode_poses
from services.live.rendering.contents import pack_environment, pack_model
from services.live.rendering.homes import Renderer
from services.live.rendering.messages import Header, pack, unpack
from services.live.room import Room
from services.live.streaming.pictures import PictureRefused
from services.live.streaming.pose_feed import room_poses

log = logging.getLogger(__name__)

_MOST_ROUNDS = 4
"""In which a renderer asks for what it lacks: it forgets only what no room needs."""
Thing = TypeVar("Thing", PerformerModel, Environment)


class _Keys:
    """Names of things, by which renderers know them."""

    def __init__(self) -> None:
        self._keys: WeakKeyDictionary[object, str] = WeakKeyDictionary()

    def of(self, thing: PerformerModel | Environment) -> str:
        return self._keys.setdefault(thing, secrets.token_hex(8))


_KEYS = _Keys()


class StagedRoom:
    """A room as one renderer has it."""

    def __init__(self, room: Room) -> None:
        self.key = secrets.token_hex(8)
        # who moves is the room's own business, who is there is not
        self.room = replace(room)
        self._tick, self._poses = -1, list[bytes]()

    def is_as(self, room: Room) -> bool:
        """Whether it is how `room` is now."""
        mine = self.room
        return mine.performers is room.performers and mine.environment is room.environment

    def poses(self, tick: int, now_s: float) -> list[bytes]:
        """A pose packet for each performer at this tick, in the world of their model."""
        if tick != self._tick:
            self._tick, self._poses = tick, _own_poses(self.room, now_s)
        return self._poses

    @property
    def header(self) -> Header:
        """What a renderer is told of it."""
        people = [
            {
                "name": one.name,
                "model": _KEYS.of(one.model),
                "position": one.position,
                "yaw_rad": one.yaw_rad,
            }
            for one in self.room.performers
        ]
        environment = _KEYS.of(self.room.environment)
        return {"room": self.key, "performers": people, "environment": environment}


class Staging:
    """The rooms that one renderer has. On the event loop."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer
        self._staged: dict[Room, StagedRoom] = {}
        self._loading: dict[Room, asyncio.Task[None]] = {}
        self._refused: dict[Room, StagedRoom] = {}
        """Of a room, how it was when it could not be read."""

    async def prepare(self, room: Room) -> None:
        """Have the renderer know `room`; it draws it as it was while it reads how it is now.

        Raises PictureRefused for what it cannot read, and RendererGone.
        """
        there = self._staged.get(room)
        if there is not None and there.is_as(room):
            return
        loading, refused = self._loading.get(room), self._refused.get(room)
        if loading is None and (there is None or refused is None or not refused.is_as(room)):
            loading = self._loading[room] = asyncio.create_task(self._load(room, there))
            loading.add_done_callback(lambda task: self._done(room, task))
        if there is None and loading is not None:
            await asyncio.shield(loading)

    def of(self, room: Room) -> StagedRoom | None:
        """`room` as the renderer has it; None where it does not know it."""
        return self._staged.get(room)

    def lost(self, room: Room) -> None:
        """The renderer does not know it any more."""
        self._staged.pop(room, None)

    def take(self, room: Room) -> list[str]:
        """Nobody looks at it any more here: the keys that the renderer may forget."""
        if (loading := self._loading.pop(room, None)) is not None:
            loading.cancel()
        self._refused.pop(room, None)
        there = self._staged.pop(room, None)
        return [] if there is None else [there.key]

    def lose_all(self) -> None:
        """The renderer is gone, and all that it had."""
        self._staged, self._refused = {}, {}

    def _done(self, room: Room, task: asyncio.Task[None]) -> None:
        if self._loading.get(room) is task:
            del self._loading[room]
        if not task.cancelled() and (error := task.exception()) is not None:
            log.warning("a renderer could not take a room: %s", error)

    async def _load(self, room: Room, before: StagedRoom | None) -> None:
        made = StagedRoom(room)
        try:
            await self._tell(made)
        except PictureRefused:
            self._refused[room] = made
            raise
        self._staged[room] = made
        if before is not None:
            await self._renderer.draw(pack({"act": "forget", "viewers": [], "rooms": [before.key]}))

    async def _tell(self, made: StagedRoom) -> None:
        models = {_KEYS.of(one.model): one.model for one in made.room.performers}
        environment = made.room.environment
        for _ in range(_MOST_ROUNDS):
            lacks = await self._ask({"act": "room", **made.header})
            if not lacks.get("models") and not lacks.get("environment"):
                return
            for key in lacks["models"]:
                data = await asyncio.to_thread(pack_model, models[key])
                await self._ask({"act": "model", "key": key}, data)
            if lacks["environment"]:
                data = await asyncio.to_thread(pack_environment, environment)
                await self._ask({"act": "environment", "key": _KEYS.of(environment)}, data)
        raise PictureRefused(
            f"a renderer must keep what it was sent; got one that lacks {lacks} after "
            f"{_MOST_ROUNDS} rounds; look into its log"
        )

    async def _ask(self, header: Header, *parts: bytes) -> Header:
        answer, _ = unpack(await self._renderer.load(pack(header, parts)))
        if "refused" in answer:
            raise PictureRefused(answer["refused"])
        return answer


def _own_poses(room: Room, now_s: float) -> list[bytes]:
    performers = room.scene_at(now_s).performers
    if not performers:
        return []
    # light as captured goes by the world of a model, so its place in the room is told apart
    unplaced = [replace(one, position=np.zeros(3), yaw_rad=0.0) for one in performers]
    pelvises, rotations = room_poses(unplaced)
    return encode_poses(
        [
            PosePacket(
                0,
                1e3 * one.pose.time_s,
                index,
                len(performers),
                0,
                pelvis,
                turns,
                expression=one.pose.expression,
            )
            for index, (one, pelvis, turns) in enumerate(
                zip(performers, pelvises, rotations, strict=True)
            )
        ]
    )
