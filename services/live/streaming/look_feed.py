"""Pictures of people with live look, to the viewers who draw the room by themselves.

Each gets the frames as their sender encoded them, from a key frame on, and the poses that the
server aligned with them; those for whom the server draws get none. Whoever's channel is clogged is
left out until they can go on from a key frame: what would come late is not how somebody looks now.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from aiortc import RTCDataChannel

from renderer.performer_model import PerformerModel
from services.live.look.packets import (
    Whose,
    encode_aligned_pose,
    encode_end,
    encode_frame,
    is_key_frame,
)
from services.live.look.picture import AlignedPose
from services.live.look.relay import LookRelay
from services.live.packets import NewestView, performer_check
from services.live.room import Room

_MOST_BUFFERED_BYTES = 40_000
"""Of one channel: room for the key frames of a few people who come at once."""


@dataclass(frozen=True, eq=False)
class _Subscriber:
    room: Room
    view: NewestView
    channel: RTCDataChannel

    @property
    def gone(self) -> bool:
        return self.channel.readyState not in ("connecting", "open")

    @property
    def draws(self) -> bool:
        return self.channel.readyState == "open" and self.view.draws_room


class LookFeed:
    """The `look` channels of all viewers. Every method runs on the event loop."""

    def __init__(self) -> None:
        self._subscribers: list[_Subscriber] = []

    def add(self, room: Room, view: NewestView, channel: RTCDataChannel) -> None:
        """Send pictures of `room` over `channel` while its viewer draws for themselves."""
        self._subscribers.append(_Subscriber(room, view, channel))

    def relay(self, room: Room, performer_id: str) -> LookRelay:
        """What passes one performer's pictures on."""
        return _PerformerRelay(self, room, performer_id)

    def drawing_in(self, room: Room) -> list[RTCDataChannel]:
        """The open channels of those in `room` who draw."""
        self._subscribers = [one for one in self._subscribers if not one.gone]
        return [one.channel for one in self._subscribers if one.room is room and one.draws]


class _PerformerRelay(LookRelay):
    """One performer's pictures."""

    def __init__(self, feed: LookFeed, room: Room, performer_id: str) -> None:
        self._feed, self._room, self._performer_id = feed, room, performer_id
        self._following: set[RTCDataChannel] = set()
        """Who has every frame since a key frame."""
        self._told: set[RTCDataChannel] = set()
        """Who shows pictures that have not been ended."""

    def pass_frame(self, number: int, data: bytes) -> bool:
        """Send it to whoever can decode it; says whether somebody could not and has room for it."""
        whose = self._whose()
        drawing = set() if whose is None else set(self._feed.drawing_in(self._room))
        clear = {one for one in drawing if one.bufferedAmount <= _MOST_BUFFERED_BYTES}
        self._following = clear if is_key_frame(data) else clear & self._following
        self._told |= self._following
        if whose is not None and self._following:
            _send(self._following, encode_frame(whose, number, data))
        return len(self._following) < len(clear)

    def drawn_model(self) -> PerformerModel | None:
        """The performer's newest model, while somebody follows."""
        if not self._following:
            return None
        members = self._room.performers
        return next((m.model for m in members if m.performer_id == self._performer_id), None)

    def pass_pose(self, number: int, aligned: AlignedPose) -> None:
        """Send it to whoever follows."""
        if (whose := self._whose()) is not None:
            _send(self._following, encode_aligned_pose(whose, number, aligned))

    def end(self) -> None:
        """Tell everybody who was ever sent a frame since the last end."""
        if (whose := self._whose()) is not None:
            _send(self._told, encode_end(whose))
        self._following, self._told = set(), set()

    def _whose(self) -> Whose | None:
        """None for somebody who is shown no longer: pages forget them by the roster."""
        ids = [member.performer_id for member in self._room.performers]
        if self._performer_id not in ids:
            return None
        return Whose(ids.index(self._performer_id), len(ids), performer_check(self._performer_id))


def _send(channels: Iterable[RTCDataChannel], data: bytes) -> None:
    for channel in channels:
        if channel.readyState == "open":
            channel.send(data)
