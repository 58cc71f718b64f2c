"""What a viewer's video asks of whatever draws it, wherever that is (services.live.rendering)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from av import Packet

from scene.camera import Camera
from scene.errors import SceneError
from services.live.room import Room
from services.live.streaming.encoding import Codec


class PictureRefused(SceneError):
    """What draws cannot draw this room; others it can."""


@dataclass(frozen=True, eq=False)
class PictureOrder:
    """One picture of a viewer, as everything is when it is begun."""

    tick: int
    now_s: float
    """Of the view sessions' clock."""
    camera: Camera
    hide_unseen: bool
    """Whether what was never filmed of a person fades out."""
    scale: float
    """Of the sides that the viewer asked for."""
    bitrate: int
    """bit/s."""
    key: bool
    """Whether it must need no picture before it."""
    stamp_ms: float | None = None
    """A capture time to write into the picture's corner, to measure latency."""


@dataclass(frozen=True, eq=False)
class CodedPicture:
    """A picture that was drawn and encoded."""

    packet: Packet
    width: int
    height: int
    draw_s: float
    encode_s: float
    """What drawing took, and what encoding took."""
    worked_s: float
    """What the thread that made it has worked for everybody since it began."""


class ViewerPictures(Protocol):
    """The pictures of one viewer, one after the other. On the event loop."""

    async def picture(self, order: Callable[[], PictureOrder]) -> CodedPicture:
        """The next picture. `order` is called once there is time for it, perhaps on another thread,
        and again where what drew it was lost: work is dropped, never queued.

        Raises PictureRefused.
        """
        ...

    def rest(self) -> None:
        """None are wanted for a while: what they hold is given back, and the next begins anew."""
        ...

    def close(self) -> None:
        """None are wanted any more."""
        ...


class Renderers(Protocol):
    """Where pictures are drawn and encoded. On the event loop."""

    @property
    def ready(self) -> bool:
        """Whether pictures come at once."""
        ...

    def warm_up(self) -> None:
        """Prepare for the first viewer; returns at once."""
        ...

    def open(self, room: Room, codec: Codec) -> ViewerPictures:
        """A place for one more viewer of `room`. Raises ServerFull where there is none."""
        ...

    async def close(self) -> None:
        """Draw no more, and leave nothing behind."""
        ...
