"""Poses to the viewers who draw the room themselves: the newest, 30 times a second, none queued.

Poses of all rooms are encoded together, once for all viewers, and go to each viewer in one message
where they take batches. Where no viewer draws for themselves nothing is encoded and nothing is
sent. In a sealed room the packets of pages are passed on in place of poses, unread.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from aiortc import RTCDataChannel

from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.environment import Performer
from scene.rotations import axis_angle_to_matrix, axis_angle_to_quaternion, matrix_to_quaternion
from services.live.packets import (
    BATCHES,
    POSE_BYTES,
    NewestView,
    PosePacket,
    batches_of,
    encode_poses,
    performer_check,
)
from services.live.room import Room
from services.live.sealed_packet import take_batches
from services.live.streaming.instrumentation import Instrumentation

POSES_PER_SECOND = 30
_MOST_BUFFERED_BYTES = 24 * POSE_BYTES
"""A channel with more than this unsent is congested: what comes next would only be older."""


@dataclass(frozen=True, eq=False)
class _Subscriber:
    room: Room
    view: NewestView
    channel: RTCDataChannel

    @property
    def takes_more(self) -> bool:
        channel = self.channel
        return (
            self.view.wants_poses
            and channel.readyState == "open"
            and channel.bufferedAmount <= _MOST_BUFFERED_BYTES
        )


class PoseFeed:
    """Sends every room's poses to its viewers; runs as long as there are subscribers."""

    def __init__(self, clock: Callable[[], float], instrumentation: Instrumentation) -> None:
        self._clock, self._instrumentation = clock, instrumentation
        self._subscribers: dict[RTCDataChannel, _Subscriber] = {}
        self._sequence = 0
        self._task: asyncio.Task[None] | None = None

    def __len__(self) -> int:
        return len(self._subscribers)

    def add(self, room: Room, view: NewestView, channel: RTCDataChannel) -> None:
        """Send the poses of `room` over `channel` whenever its viewer draws for themselves."""
        self._subscribers[channel] = _Subscriber(room, view, channel)
        if self._task is None:
            self._task = asyncio.create_task(self._run())

    def send_newest(self) -> None:
        """Send everybody's pose now to every viewer who draws."""
        self._subscribers = {
            channel: subscriber
            for channel, subscriber in self._subscribers.items()
            if channel.readyState in ("connecting", "open")
        }
        self._sequence = (self._sequence + 1) % (1 << 32)
        taking = [one for one in self._subscribers.values() if one.takes_more]
        rooms = {one.room for one in taking}
        packets = self._packets(room for room in rooms if not room.sealed)
        sealed = {room: take_batches(room) for room in rooms if room.sealed}
        batches: dict[Room, list[bytes]] = {}
        for subscriber in taking:
            room, channel = subscriber.room, subscriber.channel
            messages = sealed[room] if room.sealed else packets[room]
            if channel.protocol == BATCHES and not room.sealed:
                if room not in batches:
                    batches[room] = batches_of(messages)
                messages = batches[room]
            for data in messages:
                channel.send(data)

    async def close(self) -> None:
        """Stop sending; returns once nothing of it runs any more."""
        self._subscribers = {}
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])

    def _packets(self, rooms: Iterable[Room]) -> dict[Room, list[bytes]]:
        now_s = self._clock()
        poses = {
            room: _poses(
                room, now_s, self._sequence, self._instrumentation.pose_time_ms(room, now_s)
            )
            for room in rooms
        }
        encoded = iter(encode_poses([one for of_room in poses.values() for one in of_room]))
        return {room: list(islice(encoded, len(of_room))) for room, of_room in poses.items()}

    async def _run(self) -> None:
        due_s = self._clock()
        try:
            while self._subscribers:
                self.send_newest()
                now_s = self._clock()
                due_s = max(due_s + 1.0 / POSES_PER_SECOND, now_s)
                await asyncio.sleep(due_s - now_s)
        finally:
            self._task = None  # the next subscriber starts it anew


def pose_packets(
    room: Room, now_s: float, sequence: int, time_ms: float | None = None
) -> list[bytes]:
    """A pose packet for each performer of `room` at `now_s`; it carries `time_ms`, else `now_s`."""
    return encode_poses(
        _poses(room, now_s, sequence, 1000.0 * now_s if time_ms is None else time_ms)
    )


def _poses(room: Room, now_s: float, sequence: int, time_ms: float) -> list[PosePacket]:
    members, performers = room.performers, room.scene_at(now_s).performers
    if not members:
        return []
    pelvises, rotations = room_poses(performers)
    packets = []
    for index, (member, performer) in enumerate(zip(members, performers, strict=True)):
        live = room.live_motions.get(member.performer_id)
        packets.append(
            PosePacket(
                sequence,
                time_ms,
                index,
                len(members),
                performer_check(member.performer_id),
                pelvises[index],
                rotations[index],
                0 if live is None else live.landmarks_age_ms,
                performer.pose.expression,
            )
        )
    return packets


def room_poses(
    performers: Sequence[Performer[PerformerModel]],
) -> tuple[Float[Array, "P 3"], Float[Array, "P 24 4"]]:
    """Of each performer: where the pelvis is in the room (m), and the rotations wxyz of a
    `PosePacket`."""
    placements = np.stack([one.placement for one in performers])
    turned, moved = placements[:, :3, :3], placements[:, :3, 3]
    angles = np.stack([one.pose.joint_angles for one in performers])
    rotations = axis_angle_to_quaternion(angles)
    rotations[:, 0] = matrix_to_quaternion(turned @ axis_angle_to_matrix(angles[:, 0]))
    pelvises = np.stack(
        [one.model.skeleton.rest_joints[0] + one.pose.root_translation for one in performers]
    )
    return (turned @ pelvises[..., None])[..., 0] + moved, rotations
