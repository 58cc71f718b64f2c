"""What one renderer holds, and what it answers: bytes in, bytes out, in whatever process.

`draw` is called by one thread, `load` by another, so that a model which is read stops no picture.
What it does not know any more, because it was started anew, it says, and is told again.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.environment import Environment, Performer, Scene
from scene.errors import SceneError
from services.live.rendering.contents import pose_of, unpack_environment, unpack_model
from services.live.rendering.drawing import RoomPictures, ViewerDrawing, Workload
from services.live.rendering.messages import Header, order_of, pack, pack_picture, unpack
from services.live.streaming.encoding import Codec, PictureEncoder

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _StagedPerformer:
    name: str
    model: PerformerModel
    position: Float[Array, "3"]
    yaw_rad: float

    def in_pose(self, packet: bytes, hide_unseen: bool) -> Performer[PerformerModel]:
        return Performer(
            self.name,
            self.model.filmed_parts() if hide_unseen else self.model,
            self.position,
            self.yaw_rad,
            pose_of(packet, self.model.skeleton),
        )


@dataclass(frozen=True, eq=False)
class _StagedRoom:
    environment: Environment
    performers: tuple[_StagedPerformer, ...]
    pictures: RoomPictures = field(default_factory=RoomPictures)


class RenderStage:
    """The rooms and viewers of one renderer."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock, self._workload = clock, Workload()
        self._rooms: dict[str, _StagedRoom] = {}
        self._viewers: dict[str, ViewerDrawing] = {}
        self._models: dict[str, PerformerModel] = {}
        self._environments: dict[str, Environment] = {}
        self._acts: dict[str, Callable[[Header, list[bytes]], bytes]] = {
            "picture": self._picture,
            "forget": self._forget,
            "ping": lambda header, parts: pack({"process_id": os.getpid(), **self.held}),
            "room": self._room,
            "model": self._model,
            "environment": self._environment,
        }

    @property
    def held(self) -> dict[str, int]:
        """How many rooms, viewers and models it has."""
        held = {"rooms": self._rooms, "viewers": self._viewers, "models": self._models}
        return {name: len(things) for name, things in held.items()}

    def answer(self, request: bytes) -> bytes:
        """What comes of a request; of one that fails, why: the others go on."""
        header, parts = unpack(request)
        try:
            return self._acts[header["act"]](header, parts)
        except SceneError as error:
            return pack({"refused": str(error)})
        except Exception as error:
            log.exception("a renderer could not do what was asked")
            return pack({"refused": f"the renderer failed ({type(error).__name__}): {error}"})

    def _picture(self, header: Header, parts: list[bytes]) -> bytes:
        room = self._rooms.get(header["room"])
        if room is None:
            return pack({"unknown": True})
        if header["viewer"] not in self._viewers:
            encoder = PictureEncoder(Codec(header["codec"]))
            self._viewers[header["viewer"]] = ViewerDrawing(encoder, self._workload, self._clock)
        order = order_of(header)

        def scene() -> Scene[PerformerModel]:
            pairs = zip(room.performers, parts, strict=True)
            shown = (one.in_pose(packet, order.hide_unseen) for one, packet in pairs)
            return Scene(room.environment, tuple(shown))

        drawing = self._viewers[header["viewer"]]
        return pack_picture(drawing.picture(room.pictures, order, scene))

    def _forget(self, header: Header, parts: list[bytes]) -> bytes:
        for key in header["viewers"]:
            self._viewers.pop(key, None)
        for key in header["rooms"]:
            self._rooms.pop(key, None)
        self._prune()
        return pack({})

    def _room(self, header: Header, parts: list[bytes]) -> bytes:
        """Take a room, once all that is in it is here; says what is not."""
        models, places = self._models, self._environments
        place, people = header["environment"], header["performers"]
        missing = {one["model"] for one in people} - set(models)
        if missing or place not in places:
            return pack({"models": sorted(missing), "environment": place not in places})
        performers = tuple(
            _StagedPerformer(
                one["name"], models[one["model"]], np.array(one["position"]), one["yaw_rad"]
            )
            for one in people
        )
        self._rooms[header["room"]] = _StagedRoom(places[place], performers)
        self._prune()
        return pack({})

    def _prune(self) -> None:
        """Drop what no room needs; a room that comes meanwhile asks for it again."""
        rooms = list(self._rooms.values())
        models = {id(one.model) for room in rooms for one in room.performers}
        places = {id(room.environment) for room in rooms}
        self._models = {k: m for k, m in self._models.items() if id(m) in models}
        self._environments = {k: e for k, e in self._environments.items() if id(e) in places}

    def _model(self, header: Header, parts: list[bytes]) -> bytes:
        self._models[header["key"]] = unpack_model(parts[0])
        return pack({})

    def _environment(self, header: Header, parts: list[bytes]) -> bytes:
        self._environments[header["key"]] = unpack_environment(parts[0])
        return pack({})
